"use strict";
// The page is whole without this; it adds sorting, filters, values under the pointer, and a closer look at figures.
(() => {
  const all = (query, root = document) => [...root.querySelectorAll(query)];

  // ---- tables and folded parts ----
  const sortBy = (heading) => {
    const table = heading.closest("table"), place = [...heading.parentNode.children].indexOf(heading);
    const up = heading.getAttribute("aria-sort") === "descending";
    all("th[aria-sort]", table).forEach((other) => other.removeAttribute("aria-sort"));
    heading.setAttribute("aria-sort", up ? "ascending" : "descending");
    const value = (row) => {
      const found = row.children[place].dataset.value;
      return found === undefined || found === "" ? NaN : Number(found);
    };
    const compare = (a, b) => {
      if (place === 0) return (up ? -1 : 1) * a.dataset.name.localeCompare(b.dataset.name);
      const x = value(a), y = value(b);
      if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y);
      return (up ? 1 : -1) * (x - y);
    };
    for (const body of table.tBodies) body.append(...all("tr[data-name]", body).sort(compare));
  };
  all("th[data-sort] button").forEach((button) => button.addEventListener("click", () => sortBy(button.parentNode)));
  all("input[data-filters]").forEach((input) => input.addEventListener("input", () => {
    const wanted = input.value.trim().toLowerCase().split(/\s+/);
    for (const item of all(input.dataset.filters)) {
      item.hidden = !wanted.every((word) => item.dataset.name.toLowerCase().includes(word));
    }
  }));
  all(".tools input").forEach((input) => { input.hidden = false; });
  const reveal = () => {
    const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    for (let node = target; node; node = node.parentElement) if (node.tagName === "DETAILS") node.open = true;
    if (target) target.scrollIntoView();
  };
  addEventListener("hashchange", reveal);
  if (location.hash) reveal();

  // ---- figures ----
  all(".keys button").forEach((button) => button.addEventListener("click", () => {
    const shown = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", shown);
    all(`path.${button.dataset.key}`, button.closest("figure")).forEach((path) => path.classList.toggle("off", !shown));
  }));
  const axis = (node) => {
    const [low, high, log] = node.dataset.bounds.split(" ");
    return [Number(low), Number(high), log === "log"];
  };
  const bounds = (panel) => {
    const [x0, x1, xLog] = axis(panel.closest(".drawing")), [y0, y1, yLog] = axis(panel);
    return { x: [x0, x1], y: [y0, y1], xLog, yLog };
  };
  const at = ([low, high], log, share) => (log ? low * (high / low) ** share : low + (high - low) * share);
  const short = (value, span) => {
    const digits = Math.min(6, Math.max(0, 2 - Math.floor(Math.log10(Math.abs(span) || 1))));
    return Math.abs(value) >= 1e5 || (value && Math.abs(value) < 1e-4) ? value.toPrecision(3) : value.toFixed(digits);
  };
  const ticks = (low, high) => {
    const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * (rough < 1.5 * power ? 1 : rough < 3.5 * power ? 2 : rough < 7.5 * power ? 5 : 10);
    return Array.from({ length: 12 }, (_, i) => (Math.ceil(low / step) + i) * step).filter((tick) => tick <= high);
  };
  const SVG = document.querySelector("svg")?.namespaceURI;
  const made = (tag, attributes, ...parts) => {
    const node = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
    node.append(...parts);
    return node;
  };
  // The part of the width that a figure shows, from 0 to 1.
  const views = new WeakMap();
  const show = (drawing, from, to) => {
    const width = Math.min(1, Math.max(1e-3, to - from)), start = Math.min(1 - width, Math.max(0, from));
    const across = drawing.querySelector(".across"), own = bounds(drawing.querySelector(".panel"));
    const kept = views.get(drawing) ?? { boxes: all(".curves", drawing).map((inner) => [inner, ...inner.getAttribute("viewBox").split(" ").slice(2).map(Number)]) };
    views.set(drawing, { ...kept, view: [start, start + width] });
    kept.boxes.forEach(([inner, wide, high]) => inner.setAttribute("viewBox", `${wide * start} 0 ${wide * width} ${high}`));
    all(".marks", drawing).forEach((marks) => { marks.style.display = width < 1 ? "none" : ""; });
    // Other figures may refer to these ticks, so that they stay as they are.
    drawing.querySelector(".closer")?.remove();
    across.style.display = width < 1 ? "none" : "";
    if (width === 1) return;
    const low = at(own.x, own.xLog, start), high = at(own.x, own.xLog, start + width);
    const group = made("g", { class: "ticks x" });
    for (const tick of ticks(low, high)) {
      const place = `${100 * (own.xLog ? Math.log(tick / low) / Math.log(high / low) : (tick - low) / (high - low))}%`;
      const text = short(tick, high - low).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, "");
      group.append(made("line", { x1: place, x2: place, y2: "100%" }), made("text", { x: place, y: "100%", dy: 16 }, text));
    }
    const place = { y: across.getAttribute("y"), height: across.getAttribute("height") };
    across.after(made("svg", { class: "across closer", ...place }, group));
  };
  const viewOf = (drawing) => views.get(drawing)?.view ?? [0, 1];
  const readout = document.createElement("div");
  readout.className = "readout";
  readout.hidden = true;
  document.body.append(readout);
  for (const drawing of all("figure .drawing")) {
    let start = null;
    const place = (event) => {
      for (const panel of all(".panel", drawing)) {
        const box = panel.querySelector(".curves").getBoundingClientRect();
        const x = (event.clientX - box.left) / box.width, y = 1 - (event.clientY - box.top) / box.height;
        if (x >= 0 && x <= 1 && y >= 0 && y <= 1) return { panel, x, y };
      }
      return null;
    };
    drawing.addEventListener("pointermove", (event) => {
      const found = place(event);
      readout.hidden = found === null;
      if (found === null) return;
      const own = bounds(found.panel), view = viewOf(drawing);
      const x = at(own.x, own.xLog, view[0] + found.x * (view[1] - view[0])), y = at(own.y, own.yLog, found.y);
      readout.textContent = `${short(x, own.xLog ? x : (own.x[1] - own.x[0]) * (view[1] - view[0]))}; ${short(y, own.yLog ? y : own.y[1] - own.y[0])}`;
      readout.style.left = `${Math.min(event.clientX + 12, innerWidth - 130)}px`;
      readout.style.top = `${event.clientY - 28}px`;
    });
    drawing.addEventListener("pointerleave", () => { readout.hidden = true; });
    drawing.addEventListener("pointerdown", (event) => { if (event.pointerType === "mouse") start = place(event)?.x ?? null; });
    drawing.addEventListener("pointerup", (event) => {
      const end = place(event)?.x, view = viewOf(drawing), width = view[1] - view[0];
      if (start !== null && end !== undefined && Math.abs(end - start) > 0.02) {
        show(drawing, view[0] + Math.min(start, end) * width, view[0] + Math.max(start, end) * width);
      }
      start = null;
    });
    drawing.addEventListener("dblclick", () => show(drawing, 0, 1));
    drawing.addEventListener("keydown", (event) => {
      const [from, to] = viewOf(drawing), width = to - from;
      const moves = {
        "+": [from + width / 4, to - width / 4], "-": [from - width / 2, to + width / 2], Escape: [0, 1],
        ArrowLeft: [from - width / 4, to - width / 4], ArrowRight: [from + width / 4, to + width / 4],
      };
      const move = moves[event.key];
      if (!move) return;
      event.preventDefault();
      show(drawing, ...move);
    });
  }
})();
