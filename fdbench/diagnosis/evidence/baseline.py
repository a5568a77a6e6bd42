"""A baseline: records of the same machine before, whose own misfit is not what is asked for."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fdbench.diagnosis.evidence.sensor_artefacts import Artefact, beyond
from fdbench.diagnosis.records.noise_model import NoiseModel, spectrum_of
from fdbench.diagnosis.records.runs import RecordedRun, same_motion
from fdbench.diagnosis.settings import EVIDENCE
from fdbench.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    r"""What the model that was calibrated on the baseline leaves of it, for each command.

    A record y of the machine now, of the same command, is compared as :math:`y - (y_0 - \hat y_0)`: the error of form
    that the model has anyhow cancels, and what is left of the gap has changed since.

    Attributes
    ----------
    runs : sequence of RecordedRun
        One for each command, the mean of its repeats.
    residuals : sequence of mappings
        Channels of each, less those simulated, (n_samples,).
    artefacts : sequence of Artefact
        What its readings show by themselves.
    said : sequence of str
        What was found of the model besides its numbers.
    set_anew : mapping of str to float
        Gains of the controller that somebody has changed since, by their names, and by what share of themselves.
    """

    runs: Sequence[RecordedRun]
    residuals: Sequence[Mapping[str, FloatArray]]
    artefacts: Sequence[Artefact] = ()
    said: Sequence[str] = ()
    set_anew: Mapping[str, float] = field(default_factory=dict)

    @property
    def form_change(self) -> float:
        """By what share of itself an error of the model's form may differ now; another loop lets it act otherwise."""
        return max([EVIDENCE.form_change, *map(abs, self.set_anew.values())])

    def of(self, run: RecordedRun) -> tuple[RecordedRun, Mapping[str, FloatArray]] | None:
        """Return the baseline of a run's command and its residuals, if there is one."""
        pairs = zip(self.runs, self.residuals, strict=True)
        return next((pair for pair in pairs if same_motion(pair[0], run)), None)

    def corrected(self, run: RecordedRun) -> RecordedRun:
        """Return a run less what the model leaves of its baseline; as it is where its command has none."""
        known = self.of(run)
        if known is None:
            return run
        channels = {name: own - known[1][name] for name, own in run.channels.items()}
        return dataclasses.replace(run, channels=channels, readings=run.readings or run.channels)

    def covers(self, runs: Sequence[RecordedRun]) -> bool:
        """Return whether the command of each run has a baseline."""
        return all(self.of(run) is not None for run in runs)

    def since(self, artefact: Artefact) -> Artefact:
        """Return what readings show now, as a cause `beyond` what they showed before."""
        return beyond(artefact, [item.high for item in self.artefacts if item.kind.declared is artefact.kind.declared])

    def noise(self, found: Mapping[str, NoiseModel], runs: Sequence[RecordedRun]) -> Mapping[str, NoiseModel]:
        r"""Return noise models that hold for corrected runs: the baseline's own noise is in all repeats alike.

        .. math:: S \to S (1 + n / n_0), \qquad B \to B + \sigma^2 S_r

        with the mean numbers of repeats now and then, where repeats tell the noise; else it is in what is left. What
        the model leaves of the baseline, with the spectrum S_r, is friction for the most part, and differs from day to
        day by a share sigma, `form_change`, as all friction does: it adds to changes B from run to run.
        """
        covered = [(run, *known) for run in runs if (known := self.of(run)) is not None]
        if not covered:
            return found
        now, then = np.mean([(run.repeats, before.repeats) for run, before, _ in covered], axis=0)
        factor, left = float(1.0 + now / then), [own for *_, own in covered]
        return {
            name: self._with_form(dataclasses.replace(item, spectrum=factor * item.spectrum), name, left)
            if item.measured
            else item
            for name, item in found.items()
        }

    def _with_form(self, item: NoiseModel, name: str, left: Sequence[Mapping[str, FloatArray]]) -> NoiseModel:
        """Return a floor with what a part of what is left adds from one day to another."""
        form = spectrum_of([own[name] for own in left], 2 * (len(item.spectrum) - 1))
        between = self.form_change**2 * form
        if item.from_run_to_run is not None:
            between = between + item.from_run_to_run
        return dataclasses.replace(item, from_run_to_run=between)
