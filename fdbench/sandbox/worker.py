"""The process that holds plug-ins: it confines itself, imports them, fits, predicts and answers.

=============  ================================================  ===========================
request        holds                                             answer
=============  ================================================  ===========================
``confine``    ``own``, ``cache``, ``memory_MB`` ..           nothing
``load``       ``name``, ``file``, ``kinds``                     ``kind``, ``made_for`` ..
``construct``  ``name``, ``arguments``                           nothing
``begin``      ``name``, ``arguments``, ``context``              ``skip``, a reason or null
``record``     ``columns``                                       nothing
``fit``                                                          ``parameters`` and arrays
``predict``    ``columns`` of the command                        the array ``response``
=============  ================================================  ===========================

For `fdbench check` besides: ``stream`` answers as ``fit``, ``copy`` puts a pickled copy in place of the estimator,
``update`` tells whether a first sample ``is_refused`` before a start, and ``random_state`` tells the ``digest`` of
NumPy's global generator, after seeding it with ``seed`` unless that is null.

In place of any of these, ``error``: what went wrong, where, and after which calls.
"""

import hashlib
import io
import os
import pickle
import socket
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from fdbench.compilation import kept
from fdbench.effects import effects
from fdbench.errors import FdbenchError, PluginError
from fdbench.estimator import Context, Estimate, Estimator, OnlineEstimator, construct, estimators, samples
from fdbench.motions import motions
from fdbench.plants import plants
from fdbench.record import FloatArray, Record
from fdbench.registry import Registry, add_file
from fdbench.sandbox.claims import ARRAYS, check_kinds, check_real, declared
from fdbench.sandbox.confine import Reach, Refused, confine
from fdbench.sandbox.fault import LONGEST_TEXT, described
from fdbench.sandbox.message import Reply, Unreadable, receive_request, send_answer
from fdbench.simulate.compose import GENERATED

# Registries of which plug-in files are part of a context, and those that `load` may look for.
SIMULATED: Mapping[str, Registry[Any]] = {"effect": effects, "motion": motions, "plant": plants}
REGISTRIES: Mapping[str, Registry[Any]] = {**SIMULATED, "estimator": estimators}

MOST_PARAMETERS = 1000

# Given back before an error is answered, which is then possible even where memory has run out.
BALLAST = 2**23

# Plug-ins find another function under this name.
leave = os._exit


class PluginServer:
    """Answers requests until the other side is gone.

    Parameters
    ----------
    channel : socket
    reach : Reach
        What may be read besides the plug-in's own files.
    folder : Path
        Working folder, empty.
    """

    def __init__(self, channel: socket.socket, reach: Reach, folder: Path) -> None:
        self._channel = channel
        self._reach = reach
        self._folder = folder
        self._own: tuple[str, ...] = ()
        self._memory_MB = 0.0
        self._estimator: Estimator | None = None
        self._context: Context | None = None
        self._record: Record | None = None
        self._estimate: Estimate | None = None
        self._ballast: bytearray | None = None

    def serve(self) -> NoReturn:
        """Answer one request after another."""
        operations: dict[str, Callable[..., Reply]] = {
            "confine": self.confine,
            "load": self.load,
            "construct": self.construct,
            "begin": self.begin,
            "record": self.take_record,
            "fit": self.fit,
            "predict": self.predict,
            "stream": self.stream,
            "copy": self.copy,
            "update": self.update_first,
            "random_state": self.random_state,
            "examples": self.examples,
        }
        while True:
            try:
                request = receive_request(self._channel)
            except (EOFError, OSError):
                leave(0)
            token = request.pop("token")
            self._ballast = bytearray(BALLAST)
            try:
                send_answer(self._channel, token, operations[request.pop("do")](**request))
            except Unreadable as error:
                said = {"place": "", "text": str(error), "traceback": ""}
                send_answer(self._channel, token, Reply(header={"error": said}))
            except BaseException as error:  # noqa: BLE001 - whatever a plug-in raises is a finding
                self._ballast = None
                said = described(error, self._own, self._memory_MB)
                send_answer(self._channel, token, Reply(header={"error": said}))

    # ---- operations ----

    def confine(
        self,
        own: list[str],
        cache: str,
        memory_MB: float,
        has_landlock: bool,
        has_seccomp: bool,
        plugins: list[tuple[str, str]],
    ) -> Reply:
        """Give up all that no estimator needs, then register the plug-in files that a context may name."""
        import numba
        from numba.core.dispatcher import Dispatcher

        self._own, self._memory_MB = tuple(own), memory_MB
        sys.dont_write_bytecode = True
        folder = Path(cache)
        folder.mkdir(parents=True, exist_ok=True)
        # Kernels compiled in here must never be loaded elsewhere.
        os.environ["FDBENCH_CACHE"] = os.environ["NUMBA_CACHE_DIR"] = cache
        vars(numba.config)["CACHE_DIR"] = cache
        for name, module in list(sys.modules.items()):
            if name.startswith(("fdbench.", GENERATED)):
                for value in vars(module).values():
                    if isinstance(value, Dispatcher) and value.stats.cache_path is not None:
                        kept(value)
        files = (*own, *(os.path.realpath(file) for _, file in plugins))
        reach = Reach((*self._reach.read, *files), self._reach.listed)
        written = (self._folder, folder)
        confine(reach, written, memory_MB, has_landlock=has_landlock, has_seccomp=has_seccomp)
        os._exit = _exit_refused
        for kind, file in plugins:
            SIMULATED[kind].add_file(file)
        return Reply()

    def load(self, name: str, file: str | None, kinds: list[str]) -> Reply:
        """Import a plug-in by its file, or by its registered name."""
        registries = [REGISTRIES[kind] for kind in kinds]
        if file is not None:
            add_file(file, registries)
        for kind, registry in zip(kinds, registries, strict=True):
            if name in registry.names():
                return Reply(header={"kind": kind, **declared(registry.get(name), self._own)})
        raise PluginError(f"{name}: no plug-in of this name.")

    def construct(self, name: str, arguments: Mapping[str, Any]) -> Reply:
        """Construct an estimator, to hear whether it takes these arguments."""
        construct(name, arguments)
        return Reply()

    def begin(self, name: str, arguments: Mapping[str, Any], context: bytes) -> Reply:
        """Construct an estimator anew, and ask it whether a context is for it."""
        self._record = self._estimate = None
        self._context = ContextUnpickler(io.BytesIO(context)).load()
        self._estimator = construct(name, arguments)
        kinds = type(self._estimator).made_for
        if kinds is not None and not {self._context.model, self._context.plant.name}.intersection(kinds):
            return Reply(header={"skip": f"made for {', '.join(map(str, kinds))}"[:LONGEST_TEXT]})
        reason = self._estimator.skip(self._context)
        if reason is not None and not isinstance(reason, str):
            raise PluginError(f"skip() returned {reason!r}; a reason as text, or None, is expected.")
        return Reply(header={"skip": reason if reason is None else str.__str__(reason)[:LONGEST_TEXT]})

    def take_record(self, columns: Mapping[str, FloatArray]) -> Reply:
        """Make the record, of which nothing is said but its columns."""
        self._record = Record(columns)
        return Reply()

    def fit(self) -> Reply:
        """Fit the record."""
        estimator, context, record = self._begun()
        return self._claimed(estimator.fit(context, record))

    def _begun(self) -> tuple[Estimator, Context, Record]:
        if self._estimator is None or self._context is None or self._record is None:
            raise PluginError("fit before begin and record.")
        return self._estimator, self._context, self._record

    def _claimed(self, estimate: Any) -> Reply:
        check_kinds(estimate)
        # Each part is read once, for a class derived from Estimate may return another one each time.
        plain = Estimate(parameters=dict(estimate.parameters), **{name: getattr(estimate, name) for name in ARRAYS})
        check_kinds(plain)
        if len(plain.parameters) > MOST_PARAMETERS:
            raise PluginError(f"parameters has {len(plain.parameters)} names; at most {MOST_PARAMETERS} are allowed.")
        self._estimate = estimate
        given = {name: getattr(plain, name) for name in ARRAYS}
        parameters = {str(name): float(value) for name, value in plain.parameters.items()}
        return Reply(
            header={"parameters": parameters},
            arrays={
                name: np.ascontiguousarray(values, dtype=np.float64)
                for name, values in given.items()
                if values is not None
            },
        )

    def predict(self, columns: Mapping[str, FloatArray]) -> Reply:
        """Predict the response to a command from what has just been fitted."""
        if self._estimator is None or self._context is None or self._estimate is None:
            raise PluginError("predict before fit.")
        response = self._estimator.predict(self._context, self._estimate, Record(columns))
        if response is None:
            return Reply()
        check_real("what predict returned", response)
        return Reply(arrays={"response": np.ascontiguousarray(response, dtype=np.float64)})

    # ---- operations of `fdbench check` ----

    def stream(self) -> Reply:
        """Fit the record by ``start``, ``update`` and ``estimate``."""
        estimator, context, record = self._begun()
        if not isinstance(estimator, OnlineEstimator):
            raise PluginError("only an OnlineEstimator streams.")
        estimator.start(context)
        for sample in samples(context.regression(record)):
            estimator.update(sample)
        return self._claimed(estimator.estimate())

    def copy(self) -> Reply:
        """Go on with a pickled copy of the estimator."""
        self._estimator = pickle.loads(pickle.dumps(self._estimator))
        return Reply()

    def update_first(self) -> Reply:
        """Take in a sample before a start, which is to be refused."""
        estimator, context, record = self._begun()
        if not isinstance(estimator, OnlineEstimator):
            raise PluginError("only an OnlineEstimator takes in samples.")
        try:
            estimator.update(samples(context.regression(record))[0])
        except Refused:
            raise
        except FdbenchError:
            return Reply(header={"is_refused": True})
        return Reply(header={"is_refused": False})

    def random_state(self, seed: int | None) -> Reply:
        """Seed NumPy's global generator where there is a seed, and tell its state."""
        if seed is not None:
            np.random.seed(seed)  # noqa: NPY002
        state = pickle.dumps(np.random.get_state())  # noqa: NPY002
        return Reply(header={"digest": hashlib.sha256(state).hexdigest()})

    def examples(self) -> Reply:
        """Execute the examples in the docstring of the estimator's class, and tell what is wrong with them."""
        from fdbench.worked_examples import wrong_examples

        return Reply(header={"wrong": wrong_examples(type(self._estimator))[:LONGEST_TEXT]})


class ContextUnpickler(pickle.Unpickler):
    """Finds plug-ins through their registries, which give them their names."""

    def find_class(self, module: str, name: str) -> Any:
        for registry in SIMULATED.values():
            for plugin, place in registry.modules().items():
                if place == module:
                    registry.get(plugin)
        return super().find_class(module, name)


def _exit_refused(status: int) -> NoReturn:
    raise Refused(f"an estimator may not end its process (os._exit({status!r}))")
