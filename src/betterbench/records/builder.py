"""Incremental construction of a record, one control step at a time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import accumulate, chain, compress
from operator import attrgetter, is_not
from typing import Any

import numpy as np
import numpy.typing as npt

from betterbench.errors import InvalidInputError
from betterbench.interface.state import WorldState
from betterbench.json_form import dump_json
from betterbench.records.columns import Contacts
from betterbench.records.metadata import SCHEMA_VERSION, Outcome, RecordMetadata, Termination
from betterbench.records.record import Record

_SIMULATOR_ROWS = ("qpos", "qvel", "act", "ctrl")
_NO_ACTIVATIONS, _NOT_SEEN = np.zeros(0), np.zeros(0)
_FLOAT64 = np.dtype(np.float64)


class RecordBuilder:
    """Builder of a record from the states of one episode.

    Appending copies the simulator's arrays and stores a reference to the immutable state. All values are converted in
    :meth:`finish`, so appending takes only a few microseconds per control step.

    Raises:
        InvalidInputError: If the metadata cannot be written as JSON or has a different schema version.
    """

    def __init__(self, metadata: RecordMetadata) -> None:
        if metadata.schema_version != SCHEMA_VERSION:
            problem = f"version {metadata.schema_version!r} cannot be written"
            raise InvalidInputError("schema_version", problem, f"Use {SCHEMA_VERSION}")
        dump_json(metadata.to_json())
        self._metadata = metadata
        self._info = metadata.scene
        self._states: list[WorldState] = []
        self._rows: list[bytes] = []
        self._truths: list[tuple[Sequence[bool], Sequence[bool], bool, bool]] = []
        self._simulator: tuple[npt.NDArray[np.float64], ...] = (_NOT_SEEN,) * 4
        self._memory: tuple[memoryview | bytes, ...] = ()
        self._shapes: tuple[tuple[int, ...], ...] = ()
        self._lengths = (len(metadata.predicate_names), len(metadata.subgoal_names))
        self._no_action = np.full(len(metadata.action_components), np.nan)

    def __len__(self) -> int:
        return len(self._states)

    @property
    def states(self) -> tuple[WorldState, ...]:
        """All states that have been appended so far."""
        return tuple(self._states)

    @property
    def actions(self) -> npt.NDArray[np.float64]:
        """All actions that have been appended so far, as an array (number of rows - 1, dim)."""
        size, end = self._no_action.nbytes, len(self._rows[0]) - self._no_action.nbytes if self._rows else 0
        asked = b"".join([row[end - size : end] for row in self._rows[1:]])
        return np.frombuffer(asked).reshape(-1, len(self._no_action))

    def append(
        self,
        state: WorldState,
        *,
        predicates: Sequence[bool] = (),
        subgoals: Sequence[bool] = (),
        goal: bool,
        forbidden: bool = False,
        **given: npt.NDArray[Any] | None,
    ) -> None:
        """Append one row: a state, and the values of all predicates and subgoals in this state.

        Raises the same errors as :meth:`append_state` and :meth:`append_truth`.
        """
        self._check_truths(predicates, subgoals)
        self.append_state(state, **given)  # type: ignore[arg-type]
        self.append_truth(predicates=predicates, subgoals=subgoals, goal=goal, forbidden=forbidden)

    def append_state(
        self,
        state: WorldState,
        *,
        qpos: npt.NDArray[np.float64],
        qvel: npt.NDArray[np.float64],
        ctrl: npt.NDArray[np.float64],
        act: npt.NDArray[np.float64] = _NO_ACTIVATIONS,
        action: npt.NDArray[np.floating] | None = None,
        applied: npt.NDArray[np.floating] | None = None,
    ) -> None:
        """Append one row: the state at reset, or the state after an action.

        The arrays ``qpos`` (nq,), ``qvel`` (nv,), ``ctrl`` (nu,) and ``act`` (na,) are copied. ``act`` contains
        MuJoCo's actuator activations, which are part of the physical state. ``action`` is the policy's action and
        ``applied`` is the action after clipping, both (dim,). They are None only at reset.

        Raises:
            InvalidInputError: If the step is out of order or an array changes its shape.
        """
        step = len(self._states)
        if state.step != step:
            raise InvalidInputError(
                "state.step", f"expected {step}, got {state.step}", "Append every control step exactly once"
            )
        if state.info is not self._info:
            self._check_scene(state)
        if (action is None) is not (step == 0) or (applied is None) is not (step == 0):
            raise InvalidInputError(
                "action", f"is missing in row {step}, or given in row 0", "Pass both actions in every row except row 0"
            )
        if action is None or applied is None:
            action = applied = self._no_action
        was_qpos, was_qvel, was_act, was_ctrl = self._simulator
        if qpos is not was_qpos or qvel is not was_qvel or act is not was_act or ctrl is not was_ctrl:
            self._attend((qpos, qvel, act, ctrl))
        if action.shape != self._no_action.shape or applied.shape != self._no_action.shape:
            self._refuse_actions(action, applied)
        # Converting to bytes takes half as long as building an array of the complete row. Policies may return any
        # numeric type.
        asked = action if action.dtype is _FLOAT64 else action.astype(_FLOAT64)
        done = applied if applied.dtype is _FLOAT64 else applied.astype(_FLOAT64)
        memory = self._memory or [a.astype(_FLOAT64).tobytes() for a in self._simulator]
        self._rows.append(b"".join((*memory, asked.tobytes(), done.tobytes())))
        self._states.append(state)

    def append_truth(
        self, *, predicates: Sequence[bool] = (), subgoals: Sequence[bool] = (), goal: bool, forbidden: bool = False
    ) -> None:
        """Append the values of all predicates and subgoals in the first row that does not have them yet.

        The values have the same order as in the metadata.

        Raises:
            InvalidInputError: If a value is missing, or if all rows already have their values.
        """
        self._check_truths(predicates, subgoals)
        if len(self._truths) >= len(self._states):
            problem = f"all {len(self._states)} rows already have their predicates and subgoals"
            raise InvalidInputError(
                "predicates, subgoals", problem, "Append the next row before its predicates and subgoals"
            )
        self._truths.append((tuple(predicates), tuple(subgoals), goal, forbidden))

    def finish(
        self,
        *,
        termination: Termination,
        success: bool,
        error: str | None = None,
        clipped_actions: int = 0,
        invalid_actions: int = 0,
    ) -> Record:
        """Return the finished record. The arguments are passed to :class:`Outcome`.

        Raises:
            InvalidInputError: If there are no rows, if the values of the predicates and subgoals are missing in a row,
                if a state does not list the objects of the scene, or if the outcome is inconsistent.
        """
        outcome = Outcome(termination, bool(success), error, clipped_actions, invalid_actions)
        if not self._states:
            raise InvalidInputError("record", "has no rows", "Append the state at reset first")
        dump_json(asdict(outcome))
        rows = len(self._states)
        if len(self._truths) != rows:
            problem = f"only {len(self._truths)} of {rows} rows have their predicates and subgoals"
            raise InvalidInputError("predicates, subgoals", problem, "Append the predicates and subgoals of every row")
        bodies, contacts = _collect_contacts(self._states)
        predicates, subgoals, goals, forbidden = zip(*self._truths, strict=True)
        shapes = (*self._shapes, self._no_action.shape, self._no_action.shape)
        ends = list(accumulate(shape[0] for shape in shapes))
        table = np.frombuffer(b"".join(self._rows)).reshape(rows, ends[-1])
        qpos, qvel, act, ctrl, action, applied = (
            table[:, end - shape[0] : end].copy() for shape, end in zip(shapes, ends, strict=True)
        )
        return Record(
            metadata=self._metadata,
            outcome=outcome,
            bodies=bodies,
            qpos=qpos,
            qvel=qvel,
            act=act,
            ctrl=ctrl,
            action=action,
            applied=applied,
            held=self._held(),
            predicates=np.array(predicates, dtype=np.bool_).reshape(rows, len(self._metadata.predicate_names)),
            subgoals=np.array(subgoals, dtype=np.bool_).reshape(rows, len(self._metadata.subgoal_names)),
            goal=np.array(goals, dtype=np.bool_),
            forbidden=np.array(forbidden, dtype=np.bool_),
            contacts=contacts,
            **self._state_columns(),
        )

    def _state_columns(self) -> dict[str, npt.NDArray[np.float64]]:
        """Return the numeric columns of the states by name. All states must have the same columns."""
        states, n = self._states, len(self._info.objects)
        joints = len(states[0].joint_positions)
        sources: dict[str, tuple[str, tuple[int, ...]]] = {
            "time": ("time_s", ()),
            "ee_position": ("ee_pose.position", (3,)),
            "ee_quaternion": ("ee_pose.quaternion", (4,)),
            "commanded_position": ("commanded_pose.position", (3,)),
            "commanded_quaternion": ("commanded_pose.quaternion", (4,)),
            "finger_width": ("finger_width_m", ()),
            "gripper_command": ("gripper_command", ()),
            "joint_positions": ("joint_positions", (joints,)),
            "joint_velocities": ("joint_velocities", (joints,)),
            "object_positions": ("positions", (n, 3)),
            "object_quaternions": ("quaternions", (n, 4)),
            "object_linear_speeds": ("linear_speeds", (n,)),
            "object_angular_speeds": ("angular_speeds", (n,)),
        }
        columns = {}
        for name, (source, shape) in sources.items():
            try:
                columns[name] = _column(list(map(attrgetter(source), states)), shape)
            except (TypeError, ValueError) as error:
                cure = f"Pass numbers of the shape {shape} in every row"
                raise InvalidInputError(f"state.{source}", str(error), cure) from error
        return columns

    def _held(self) -> npt.NDArray[np.int16]:
        """Return the index of the held object in every row, or -1 if no object is held."""
        index = {o.name: i for i, o in enumerate(self._info.objects)}
        held = [-1 if s.held is None else index.get(s.held, -2) for s in self._states]
        if -2 in held:
            row = held.index(-2)
            problem = f"{self._states[row].held!r} is not an object of the scene (row {row})"
            raise InvalidInputError("state.held", problem, "Use the name of a scene object")
        return np.array(held, dtype=np.int16)

    def _check_scene(self, state: WorldState) -> None:
        """Raise InvalidInputError if a state does not belong to the scene that the metadata describes."""
        if state.info != self._info:
            raise InvalidInputError(
                "state.info", "differs from the scene in the metadata", "Use the same SceneInfo for both"
            )
        self._info = state.info  # so that the next comparison is a fast identity check

    def _check_truths(self, predicates: Sequence[bool], subgoals: Sequence[bool]) -> None:
        """Raise InvalidInputError unless there is one value for each predicate and subgoal in the metadata."""
        if (len(predicates), len(subgoals)) != self._lengths:
            problem = f"got {len(predicates)} predicates and {len(subgoals)} subgoals"
            cure = f"Pass {self._lengths[0]} predicates and {self._lengths[1]} subgoals"
            raise InvalidInputError("predicates, subgoals", problem, cure)

    def _attend(self, simulator: tuple[npt.NDArray[np.float64], ...]) -> None:
        """Check the shapes of the simulator's arrays.

        Raises InvalidInputError if a shape changes during the episode.
        """
        shapes = tuple(a.shape for a in simulator)
        for name, shape, known in zip(_SIMULATOR_ROWS, shapes, self._shapes or shapes, strict=True):
            if len(shape) != 1:
                raise InvalidInputError(name, f"has the shape {shape}", "Pass a flat array")
            if shape != known:
                raise InvalidInputError(
                    name, f"has the shape {shape}, expected {known}", "Keep the same shape during an episode"
                )
        self._shapes, self._simulator = shapes, simulator
        plain = all(a.dtype is _FLOAT64 and a.flags.c_contiguous for a in simulator)
        self._memory = tuple(a.data.cast("B") if a.size else b"" for a in simulator) if plain else ()

    def _refuse_actions(self, action: npt.NDArray[np.floating], applied: npt.NDArray[np.floating]) -> None:
        """Raise InvalidInputError for the first action that does not have the shape in the metadata."""
        due = self._no_action.shape
        name, shape = ("action", action.shape) if action.shape != due else ("applied", applied.shape)
        raise InvalidInputError(name, f"has the shape {shape}, expected {due}", f"Pass {due[0]} numbers")


def _column(values: Sequence[Any], shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    """Return the values of all rows as an array (T, *shape). Raises ValueError if a row has a wrong shape.

    Nested values are flattened first, because NumPy would take three times as long to determine their shape. A value
    that is the same Python object as in the previous row, for example because a scene object is at rest, is flattened
    only once.
    """
    new = [0, *compress(range(1, len(values)), map(is_not, values[1:], values))]
    flat: Iterable[Any] = [values[i] for i in new]
    for length in shape:
        flat = list(flat)
        wrong = {*map(len, flat)} - {length}
        if wrong:
            raise ValueError(f"a row has {min(wrong)} values, expected {length}")
        flat = chain.from_iterable(flat)
    found = np.fromiter(flat, np.float64, len(new) * math.prod(shape)).reshape(len(new), *shape)
    return found if len(new) == len(values) else found.repeat(np.diff([*new, len(values)]), axis=0)


def _collect_contacts(states: Sequence[WorldState]) -> tuple[tuple[str, ...], Contacts]:
    """Return the names of all bodies in contact, in order of appearance, and the contacts of all states."""
    found = list(chain.from_iterable(state.contacts for state in states))
    first, second, forces = zip(*found, strict=True) if found else ((), (), ())
    index = {name: i for i, name in enumerate(dict.fromkeys(chain.from_iterable(zip(first, second, strict=True))))}
    bodies = np.empty((len(found), 2), dtype=np.int16)
    for column, names in enumerate((first, second)):
        bodies[:, column] = np.fromiter(map(index.__getitem__, names), np.int16, len(found))
    counts = np.fromiter((len(state.contacts) for state in states), np.int32, len(states))
    offsets = np.concatenate((np.zeros(1, dtype=np.int32), np.cumsum(counts, dtype=np.int32)))
    return tuple(index), Contacts(offsets, bodies, np.array(forces, dtype=np.float64))
