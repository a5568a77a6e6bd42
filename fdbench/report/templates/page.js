"use strict";
// A figure is drawn when it comes near the screen, and again when light turns to dark.
(() => {
  const touch = matchMedia("(hover: none)").matches;
  const config = {
    responsive: true, displaylogo: false, showTips: false, showSendToCloud: false, plotlyServerURL: "",
    modeBarButtons: [["zoom2d", "pan2d", "resetScale2d", "toImage"]],
  };
  const sources = new Map();
  for (const script of document.querySelectorAll("script[data-plot]")) {
    sources.set(document.getElementById(script.dataset.plot), script);
  }
  const coloured = (node, style) => {
    if (typeof node === "string") {
      const match = /^var\((--[\w-]+)\)(\/\w\w)?$/.exec(node);
      return match ? style.getPropertyValue(match[1]).trim() + (match[2] || "").slice(1) : node;
    }
    if (Array.isArray(node)) return node.map((item) => coloured(item, style));
    if (node && typeof node === "object") {
      return Object.fromEntries(Object.entries(node).map(([key, item]) => [key, coloured(item, style)]));
    }
    return node;
  };
  const drawn = new Set();
  const draw = (element) => {
    const figure = coloured(JSON.parse(sources.get(element).textContent), getComputedStyle(document.documentElement));
    if (touch) figure.layout.dragmode = false; // a finger on a figure scrolls the page
    const displayModeBar = figure.layout.dragmode === false ? false : "hover";
    Plotly.react(element, figure.data, figure.layout, { ...config, displayModeBar });
    drawn.add(element);
  };
  const watcher = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (entry.isIntersecting && !drawn.has(entry.target)) draw(entry.target);
    }
  }, { rootMargin: "600px" });
  sources.forEach((_, element) => watcher.observe(element));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => drawn.forEach(draw));
  addEventListener("beforeprint", () => sources.forEach((_, element) => drawn.has(element) || draw(element)));
})();
