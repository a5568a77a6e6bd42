"""Repeatability: what changes from run to run as nominal parameters do, separated from the noise within a run.

Friction is never the same twice. Between repeats of one command it differs by a few per cent, which looks the same in
every sample of a run: counted as noise, it would hide effects that are far smaller. It is estimated from the repeats,
and counts in one direction of all samples of a run instead of in each of them.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.replay import PIECE, Replay
from fdbench.diagnosis.records.noise_model import SMALLEST, NoiseModel, noise_models, spectrum_of
from fdbench.diagnosis.records.runs import RecordedRun, deviations, repeated, same_motion
from fdbench.diagnosis.settings import EVIDENCE, RECORDS
from fdbench.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Change:
    r"""Directions in which a run may differ from another of the same command.

    What a run differs by has the covariance :math:`I + S S^T` in units of the noise, with
    :math:`S = U \operatorname{diag}(s) V^T`. Its inverse root leaves what is across :math:`U` as it is, and shrinks
    what is along it by :math:`1 / \sqrt{1 + s^2}`.

    Attributes
    ----------
    directions : (n_directions, n_channels, n_samples) array
        :math:`U^T`.
    shrinkage : (n_directions,) array
        :math:`1 - 1 / \sqrt{1 + s^2}`.
    """

    directions: FloatArray
    shrinkage: FloatArray

    def whiten(self, signals: Sequence[FloatArray]) -> None:
        """Whiten signals in place: for each channel an array (n_signals, n_samples) in units of the noise."""
        parts = list(zip(signals, self.directions.transpose(1, 0, 2), strict=True))
        along = sum(own @ directions.T for own, directions in parts) * self.shrinkage
        for own, directions in parts:
            for first in range(0, own.shape[1], PIECE):
                piece = slice(first, first + PIECE)
                own[:, piece] -= along @ directions[:, piece]

    def deviation(self, whitened: Sequence[FloatArray]) -> float:
        r"""Return by how many standard deviations a run is another one, of a gap that is whitened.

        .. math:: \sqrt{\sum_d z_d^2 a_d^2 / \sum_d a_d^2}, \qquad a_d = z_d / (1 - b_d)

        with z, the whitened gap along each direction, weighted by what is whitened away there: along directions of
        small changes there is as much of what a model lacks.
        """
        along = np.einsum("dcn,cn->d", self.directions, np.stack(whitened))
        squares = (along / (1.0 - self.shrinkage)) ** 2
        return float(np.sqrt(squares @ along**2 / max(float(squares.sum()), 1e-300)))


def within(floor: NoiseModel, left: Sequence[FloatArray]) -> NoiseModel:
    """Return a floor whose noise within a run is half of what changes from run to run leave of the differences."""
    spectrum = 0.5 * spectrum_of(left)
    between = np.maximum(floor.spectrum - spectrum, 0.0)
    return dataclasses.replace(floor, spectrum=spectrum, from_run_to_run=between)


def with_unseen(floor: NoiseModel, assumed: float, n_pairs: int) -> NoiseModel:
    """Return a floor with what is to be expected from run to run besides what pairs of repeats showed.

    ``assumed`` is the mean square that is expected where nothing is repeated.
    """
    weight = EVIDENCE.assumed_pairs / (EVIDENCE.assumed_pairs + n_pairs)
    return dataclasses.replace(floor, unseen=max(weight * (assumed - (floor.total**2 - floor.rms**2)), 0.0))


def responses(replay: Replay, model: Hypothesis, run: RecordedRun) -> FloatArray:
    """Return what one standard deviation of each nominal parameter that changes from run to run does to the channels.

    An array (n_parameters, n_channels, n_samples).
    """
    changing = [item.changes_from_run_to_run for item in nominal_parameters(model.nominal)]
    moved = [item for item, changes in zip(model.moved_in_turn(), changing, strict=True) if changes]
    simulated = replay.simulate(run, [item.variant for item in (model, *moved)])
    return np.stack([simulated[name][1:] - simulated[name][0] for name in run.channels], axis=1)


def assumed_root(model: Hypothesis) -> FloatArray:
    """Return a root of the covariance from run to run that no repeats tell: friction is never the same twice."""
    changing = [item for item in nominal_parameters(model.nominal) if item.changes_from_run_to_run]
    deviations = [item.relative_deviation for item in changing]
    shares = [0.0 if deviation is None else EVIDENCE.assumed_change / deviation for deviation in deviations]
    return np.diag(shares)


class Repeatability:
    r"""What repeats of all commands tell of changes from run to run.

    Each difference d of two repeats is explained by a difference of the nominal parameters,
    :math:`\theta = (R R^T + I)^{-1} R d` with the responses R in units of the noise; what that leaves is noise, and
    :math:`\tfrac12 \overline{\theta \theta^T}`, less what noise adds to it, is the covariance of the values from run to
    run. Two runs may be alike by chance: what is assumed to change where nothing is repeated counts for as much as
    :math:`n_0` differences beside n that were measured, so that a mean square from run to run is expected to be

    .. math:: \sigma^2 = (n \, \sigma_n^2 + n_0 \sigma_0^2) / (n + n_0)

    Parameters
    ----------
    replay : Replay
    model : Hypothesis
        About which responses are taken.
    runs : sequence of RecordedRun
        Before repeats are merged.

    Attributes
    ----------
    noise_models : mapping of str to NoiseModel
        Noise of each channel, apart from what changes from run to run. Where nothing was repeated, both are assumed.
    """

    def __init__(self, replay: Replay, model: Hypothesis, runs: Sequence[RecordedRun]) -> None:
        self._replay, self._model = replay, model
        self._known: list[tuple[RecordedRun, FloatArray]] = []
        self.noise_models = noise_models(runs, model.nominal.way)
        self._root = assumed_root(model)
        pairs = repeated(runs)
        if not pairs:
            if self._root.any() and not any(floor.measured for floor in self.noise_models.values()):
                self.noise_models = self._with_assumed_changes(runs)
            return
        names = list(runs[0].channels)
        differences = [
            np.stack([deviations(later, name) - deviations(run, name) for name in names]) for run, later in pairs
        ]
        rms = np.array([floor.rms for floor in self.noise_models.values()])
        for _ in range(EVIDENCE.rounds):
            thetas, left, by_noise = [], [], []
            for (run, _), difference in zip(pairs, differences, strict=True):
                moved = self._responses(run)
                columns = (moved / rms[:, None]).reshape(len(moved), -1)
                normal = columns @ columns.T + np.eye(len(moved))
                thetas.append(np.linalg.solve(normal, columns @ (difference / rms[:, None]).ravel()))
                by_noise.append(2.0 * np.linalg.solve(normal, np.linalg.solve(normal, columns @ columns.T).T))
                left.append(difference - np.tensordot(thetas[-1], moved, 1))
            mean_square = 0.5 * np.mean(np.concatenate(left, axis=1) ** 2, axis=1)
            rms = np.maximum(np.sqrt(mean_square), SMALLEST)
        changes = np.concatenate(self._assumed_changes(runs), axis=2)
        assumed = np.mean(np.sum(changes**2, axis=0), axis=1)
        told = [np.outer(theta, theta) - own for theta, own in zip(thetas, by_noise, strict=True)]
        size, axes = np.linalg.eigh(0.5 * np.mean(told, axis=0))
        self._root = axes * np.sqrt(np.maximum(size, 0.0))
        self.noise_models = {
            name: with_unseen(within(floor, [parts[place] for parts in left]), float(assumed[place]), len(pairs))
            for place, (name, floor) in enumerate(self.noise_models.items())
        }

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the nominal parameters from run to run, in their standard deviations, (n_values, n_values)."""
        return np.asarray(self._root @ self._root.T)

    def _with_assumed_changes(self, runs: Sequence[RecordedRun]) -> dict[str, NoiseModel]:
        """Return floors that are assumed, and what changes that are assumed, too, would add from run to run."""
        changes = self._assumed_changes(runs)
        found = {}
        for place, (name, floor) in enumerate(self.noise_models.items()):
            every = [[own[index, place] for own in changes] for index in range(len(self._root))]
            between = np.sum([spectrum_of(own, RECORDS.piece_samples) for own in every], axis=0)
            found[name] = dataclasses.replace(floor, from_run_to_run=between)
        return found

    def _assumed_changes(self, runs: Sequence[RecordedRun]) -> list[FloatArray]:
        """Return what each change that is assumed does to each run, (n_changes, n_channels, n_samples)."""
        return [np.tensordot(self._root.T, self._responses(run), 1) for run in runs]

    def _responses(self, run: RecordedRun) -> FloatArray:
        known = next((found for other, found in self._known if same_motion(run, other)), None)
        if known is None:
            known = responses(self._replay, self._model, run)
            self._known.append((run, known))
        return known

    def change(self, run: RecordedRun, noise: Mapping[str, NoiseModel]) -> Change | None:
        """Return the directions in which a run may differ from others of its command, if any."""
        if not self._root.any():
            return None
        scale = np.array([floor.rms for floor in noise.values()])[:, None]
        moved = np.tensordot(self._root.T, self._responses(run), 1) / scale
        _, s, directions = np.linalg.svd(moved.reshape(len(moved), -1), full_matrices=False)
        kept = s > EVIDENCE.smallest_change
        if not kept.any():
            return None
        return Change(
            directions=directions[kept].reshape(-1, *moved.shape[1:]),
            shrinkage=1.0 - 1.0 / np.sqrt(1.0 + s[kept] ** 2),
        )
