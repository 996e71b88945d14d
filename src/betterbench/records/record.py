"""Privileged log of one episode. From this record, the episode can be judged again without a simulator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from betterbench.geometry import Pose
from betterbench.interface.state import Contact, WorldState
from betterbench.records.columns import COLUMNS, Contacts
from betterbench.records.metadata import Outcome, RecordMetadata

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

_BLOCK_ROWS = 256
"""Number of rows that are converted to states at once. Larger blocks are faster but need more memory."""


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Privileged log of one episode.

    Row 0 is the state at reset, and row ``t`` is the state after action ``t``. ``T`` is the number of rows and ``n``
    the number of objects. All poses are in the world frame. The arrays are read-only.

    Attributes:
        bodies: Names of all bodies that occur in contacts.
        time: Simulated time since reset (T,) [s].
        qpos: Generalized positions of the simulator (T, nq).
        qvel: Generalized velocities of the simulator (T, nv).
        act: Actuator activations, which are the joint references that the servos integrate (T, na).
        ctrl: Actuator commands (T, nu).
        action: Action of the policy (T, dim). NaN in row 0.
        applied: Action after clipping (T, dim). NaN in row 0.
        ee_position: Tool center point (T, 3) [m].
        ee_quaternion: Rotation of the tool (T, 4), as (w, x, y, z).
        commanded_position: Commanded tool center point (T, 3) [m].
        commanded_quaternion: Commanded rotation of the tool (T, 4), as (w, x, y, z).
        finger_width: Distance between the finger pads (T,) [m].
        gripper_command: Last applied gripper command (T,), from -1 (open) to +1 (closed).
        joint_positions: Arm joint angles (T, joints) [rad].
        joint_velocities: Arm joint velocities (T, joints) [rad/s].
        object_positions: Object positions (T, n, 3) [m].
        object_quaternions: Object rotations (T, n, 4), as (w, x, y, z).
        object_linear_speeds: Object speeds (T, n) [m/s].
        object_angular_speeds: Object angular speeds (T, n) [rad/s].
        held: Index of the held object, or -1 (T,).
        predicates: Whether each predicate in ``metadata.predicate_names`` holds (T, p).
        subgoals: Whether each subgoal in ``metadata.subgoal_names`` holds (T, g).
        goal: Whether the goal is met (T,).
        forbidden: Whether a forbidden event is happening (T,).
        contacts: Contacts of all rows.
    """

    metadata: RecordMetadata
    outcome: Outcome
    bodies: tuple[str, ...]
    time: FloatArray
    qpos: FloatArray
    qvel: FloatArray
    act: FloatArray
    ctrl: FloatArray
    action: FloatArray
    applied: FloatArray
    ee_position: FloatArray
    ee_quaternion: FloatArray
    commanded_position: FloatArray
    commanded_quaternion: FloatArray
    finger_width: FloatArray
    gripper_command: FloatArray
    joint_positions: FloatArray
    joint_velocities: FloatArray
    object_positions: FloatArray
    object_quaternions: FloatArray
    object_linear_speeds: FloatArray
    object_angular_speeds: FloatArray
    held: npt.NDArray[np.int16]
    predicates: BoolArray
    subgoals: BoolArray
    goal: BoolArray
    forbidden: BoolArray
    contacts: Contacts

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for array in (*self.arrays().values(), self.contacts.offsets, self.contacts.bodies, self.contacts.forces):
            array.setflags(write=False)

    def __len__(self) -> int:
        return int(self.time.shape[0])

    @property
    def n_steps(self) -> int:
        """Number of control steps that were taken."""
        return len(self) - 1

    @property
    def widths(self) -> dict[str, int]:
        """Number of items per row for each name in ``WIDTH_NAMES``."""
        return {
            "nq": self.qpos.shape[1],
            "nv": self.qvel.shape[1],
            "na": self.act.shape[1],
            "nu": self.ctrl.shape[1],
            "joints": self.joint_positions.shape[1],
            "action": self.action.shape[1],
            "objects": self.object_positions.shape[1],
            "predicates": self.predicates.shape[1],
            "subgoals": self.subgoals.shape[1],
        }

    def arrays(self) -> Mapping[str, npt.NDArray[np.generic]]:
        """Return all columns except the contacts, by name."""
        return {column.name: getattr(self, column.name) for column in COLUMNS}

    def same_bits(self, other: Record) -> bool:
        """Return whether two records are identical in their metadata and, bit for bit, in all columns."""
        if (self.metadata, self.outcome, self.bodies) != (other.metadata, other.outcome, other.bodies):
            return False
        mine, theirs = (
            [*r.arrays().values(), r.contacts.offsets, r.contacts.bodies, r.contacts.forces] for r in (self, other)
        )
        return all(
            a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
            for a, b in zip(mine, theirs, strict=True)
        )

    def state(self, row: int) -> WorldState:
        """Return the state of one row.

        Negative rows count from the end. Raises IndexError if the row is out of range.
        """
        rows = len(self)
        if not -rows <= row < rows:
            msg = f"row {row} does not exist in a record with {rows} rows"
            raise IndexError(msg)
        row %= rows
        return next(self._block(row, row + 1))

    def states(self) -> Iterator[WorldState]:
        """Yield the state of every row, exactly as it was appended."""
        for start in range(0, len(self), _BLOCK_ROWS):
            yield from self._block(start, min(start + _BLOCK_ROWS, len(self)))

    def _block(self, start: int, stop: int) -> Iterator[WorldState]:
        """Yield the states of the rows from ``start`` to ``stop - 1``."""
        info, bodies = self.metadata.scene, self.bodies
        n = len(info.objects)
        held_names = [*(o.name for o in info.objects), None]  # index -1 (no object) selects None
        offsets = self.contacts.offsets[start : stop + 1].tolist()
        first, last = offsets[0], offsets[-1]
        touching = [
            Contact(bodies[a], bodies[b], force)
            for (a, b), force in zip(
                self.contacts.bodies[first:last].tolist(), self.contacts.forces[first:last].tolist(), strict=True
            )
        ]
        positions = _tuples(self.object_positions[start:stop])
        quaternions = _tuples(self.object_quaternions[start:stop])
        rows = zip(
            self.time[start:stop].tolist(),
            _tuples(self.object_linear_speeds[start:stop]),
            _tuples(self.object_angular_speeds[start:stop]),
            map(Pose, _tuples(self.ee_position[start:stop]), _tuples(self.ee_quaternion[start:stop])),
            map(Pose, _tuples(self.commanded_position[start:stop]), _tuples(self.commanded_quaternion[start:stop])),
            self.finger_width[start:stop].tolist(),
            self.gripper_command[start:stop].tolist(),
            _tuples(self.joint_positions[start:stop]),
            _tuples(self.joint_velocities[start:stop]),
            self.held[start:stop].tolist(),
            strict=True,
        )
        for i, (time, speeds, turning, ee, commanded, width, command, joints, joint_speeds, held) in enumerate(rows):
            yield WorldState(
                info=info,
                step=start + i,
                time_s=time,
                positions=tuple(positions[i * n : i * n + n]),
                quaternions=tuple(quaternions[i * n : i * n + n]),
                linear_speeds=speeds,
                angular_speeds=turning,
                ee_pose=ee,
                commanded_pose=commanded,
                finger_width_m=width,
                gripper_command=command,
                joint_positions=joints,
                joint_velocities=joint_speeds,
                contacts=tuple(touching[offsets[i] - first : offsets[i + 1] - first]),
                held=held_names[held],
            )


def _tuples(values: FloatArray) -> list[Any]:
    """Convert an array (..., k) to a flat list of tuples with k floats each.

    Slicing one list of floats is several times faster than converting each small array into a tuple. The items of the
    result have the type Any because the length of the tuples depends on the array.
    """
    width = values.shape[-1]
    if width == 0:
        return [()] * values.shape[0]
    flat = values.reshape(-1).tolist()
    return list(zip(*(flat[k::width] for k in range(width)), strict=True))
