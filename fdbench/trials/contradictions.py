"""Contradictions: what no answer may say at the same time."""

import re
from collections.abc import Iterator

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.settings import JUDGE

WORSE = 1.02  # ratio of two gaps that no noise of the judgement explains
ROUNDING = 1e-9
A_LITTLE = 0.2  # share of a gap that is no longer a little of it
SHARE = re.compile(r"(\d+) %(?= of (?:the|it|their)\b| instead of)|(?:instead of|share|removes?|explains) (\d+) %")
NAMED = re.compile(r"Cause: |Perhaps |Cannot be distinguished|Nominal parameter|acts beyond what")


def contradictions(answer: Answer) -> Iterator[str]:
    """Yield each pair of statements of an answer that cannot both hold; nothing where it agrees with itself.

    Of probabilities: "no gap" beside an unknown or a named cause. Of sizes: a named cause that explains nothing, a step
    after which more is left, shares beyond the whole, a final model that is worse than the one without its effects.
    """
    for name, value in (("unknown", answer.unknown_probability), ("no gap", answer.no_gap_probability)):
        if not 0.0 <= value <= 1.0:
            yield f"the probability of {name} is {value:g}"
    if answer.no_gap_probability + answer.unknown_probability > 1.0 + ROUNDING:
        yield f"no gap {answer.no_gap_probability:.3g} and unknown {answer.unknown_probability:.3g}"
    steps = {step.added: step for step in answer.shrinkage.steps}
    for cause in answer.causes:
        said = f"{cause.effect} with probability {cause.probability:.3g}"
        if not 0.0 <= cause.probability <= 1.0:
            yield f"{said}"
        if cause.probability + answer.no_gap_probability > 1.0 + ROUNDING:
            yield f"{said} and no gap {answer.no_gap_probability:.3g}"
        if not -ROUNDING <= cause.unique_share <= cause.share + ROUNDING or cause.share > 1.0 + ROUNDING:
            yield f"{said}: share {cause.share:.3g}, of its own {cause.unique_share:.3g}"
        if cause.probability > JUDGE.named and cause.share <= 0.0:
            yield f"{said}, and it explains {cause.share:.3g} of the gap"
        step = steps.get(cause.effect)
        if cause.probability > JUDGE.named and step is not None and step.reduction <= 0.0:
            yield f"{said}, and with it {step.after:.3g} is left of {step.before:.3g}"
    for channel_shares in (answer.where.motion, answer.where.channel):
        total = sum(channel_shares.values())
        if channel_shares and not (abs(total) < 1e-6 or abs(total - 1.0) < 1e-6):
            yield f"shares of {', '.join(channel_shares)} add up to {total:.6g}"
    before, after = (
        sum((getattr(own, stage) / own.noise_floor) ** 2 for own in answer.gap.channels.values())
        for stage in ("recalibrated", "repaired")
    )
    if after > WORSE**2 * before:
        yield f"the final model leaves {after / before:.3g} times the mean square of the re-calibrated one"


def contradictions_in_words(text: str) -> Iterator[str]:
    """Yield what the text of an answer says that cannot be, or not beside what it says elsewhere.

    Shares beyond the whole, "too" where nothing was named before, "a little" beside a large share.
    """
    words = " ".join(text.split())
    for found in SHARE.finditer(words):
        if int(found[1] or found[2]) > 100:
            yield f"a share beyond the whole: {found[0]}"
    for too in re.finditer(r"Perhaps \w+ too,|Something else is missing too", words):
        if not NAMED.search(words, 0, too.start()):
            yield f"{too[0]!r} and nothing before"
    for names in re.findall(r"No cause is named; (.+?) fitted a little", words):
        for name in names.split(" and "):
            share = re.search(rf"\b{re.escape(name)}(?:, a nominal parameter)?: share (?:above )?(\d+) %", words)
            if share and int(share[1]) > 100.0 * A_LITTLE:
                yield f"{name} fitted a little, and its share is {share[1]} %"
