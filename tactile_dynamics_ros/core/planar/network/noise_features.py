"""What is known at run time of how good a pose or force is, as numbers for a noise model.

A noise model says by which factor a stated standard deviation is off. It sees no truth: how much
of the object was visible, how the touch began, whether the tip slides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.observation import MeasuredWrench, relative_std
from tactile_dynamics_ros.core.planar.filter.process import PusherMotion

TOUCH, LOOK = 9, 6
"""Numbers that a noise model sees of a touch and of a look. They follow from `Touched.features` and
`Looked.features`; other ones need another training."""
UNKNOWN = (0.01, 0.2)
"""Standard deviation of place, m, and yaw, rad, from which a tracker says that it does not know:
a round object's turn, or several turns that look alike. No model may call that known."""
_LASTING = 8
"""Images, half a second at 15 Hz, over which errors of poses are taken together: some of what a
filter averages while it follows an object. Taken one by one, nets state less, and the filter's
poses are off by more of their std (NEES 2.5 in place of 1.7)."""
_SLOW = 1e-3
"""Speed, m/s, below which a pusher's own changes are not measured against it: that of the noise of
poses. Without it a tip that stands would divide by nothing."""
_SLIGHT = 0.1
"""Force, N, beside which a share of it means something: three times the noise of a sensor. Without
it friction of a touch that hardly presses would be any number."""
_LONGEST = 2.0
"""Time of touch, s, beyond which a touch counts as old: what its start did has faded long before,
and networks see no numbers that their training did not have."""


@dataclass(frozen=True, eq=False)
class Touched:
    """N steps in which something was touched.

    Attributes:
        force: (N, 2) N on the object, mean over the step. last: the same of the step before, zero
            where nothing was touched.
        std: (N,) N, that the sensor states of the mean.
        normal: (N, 2) into the object.
        velocity: (N, 2) m/s of the pusher. before: the same in the step before.
        slip: (N,) m/s at which the tip slides along the object, as far as is believed.
        since: (N,) s since the touch began, at the step's start.
        share: (N,) of the step's samples in which something was touched.
        step: (N,) s.
    """

    force: Array
    last: Array
    std: Array
    normal: Array
    velocity: Array
    before: Array
    slip: Array
    since: Array
    share: Array
    step: Array

    @property
    def stated(self) -> Array:
        """(N,) standard deviation, N, of sensor and mechanics without a noise model."""
        return np.asarray(np.hypot(self.std, relative_std(self.force)))

    @property
    def features(self) -> Array:
        """(N, TOUCH) numbers of the order of one."""
        size = np.linalg.norm(self.force, axis=1)
        speed = np.linalg.norm(self.velocity, axis=1) + _SLOW
        changed = np.linalg.norm(self.velocity - self.before, axis=1)
        jump = np.linalg.norm(self.force - self.last, axis=1)
        x, y = self.normal.T
        across = np.abs(self.force[:, 1] * x - self.force[:, 0] * y)
        into = np.abs(self.force[:, 0] * x + self.force[:, 1] * y)
        return np.column_stack(
            [
                np.log(size + _SLIGHT),
                across / (into + _SLIGHT),
                np.log1p(jump / self.stated),
                np.log(speed / _SLOW),
                np.minimum(changed / speed, 2.0),
                np.minimum(np.abs(self.slip) / speed, 2.0),
                np.log(np.minimum(self.since, _LONGEST) + self.step),
                self.share,
                np.log(self.step),
            ]
        )


@dataclass(frozen=True, eq=False)
class Looked:
    """N poses that were reported of images.

    Attributes:
        visible: (N,) share of the near side that nothing hides.
        matched: (N,) share of the visible model that is seen where it should be.
        points: (N,) pixels of the object. misfit: (N,) whitened distance of those from its surface.
        std: (N, 3) that the tracker states of x, y (m) and yaw (rad).
    """

    visible: Array
    matched: Array
    points: Array
    misfit: Array
    std: Array

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N, 2) whether the tracker says that it knows place and yaw at all."""
        return np.column_stack(
            [self.std[:, :2].max(axis=1) < UNKNOWN[0], self.std[:, 2] < UNKNOWN[1]]
        )

    @property
    def features(self) -> Array:
        """(N, LOOK) numbers of the order of one."""
        place = np.sqrt(self.std[:, 0] * self.std[:, 1])
        return np.column_stack(
            [
                self.visible,
                self.matched,
                np.log1p(self.points) / 7.0,
                self.misfit,
                np.log(np.minimum(place, UNKNOWN[0]) / 1e-3),
                np.log(np.minimum(self.std[:, 2], UNKNOWN[1]) / 1e-2),
            ]
        )


def joined_touches(parts: Sequence[Touched]) -> Touched:
    """Several steps as one."""
    return Touched(*(_joined(parts, field.name) for field in fields(Touched)))


def joined_looks(parts: Sequence[Looked]) -> Looked:
    """Several poses as one."""
    return Looked(*(_joined(parts, field.name) for field in fields(Looked)))


def _joined(parts: Sequence[Touched] | Sequence[Looked], name: str) -> Array:
    return np.concatenate([getattr(part, name) for part in parts])


def lasting(white: Array) -> Array:
    """Sums of errors over their std (N, d) around each look, over the root of their number.

    Of independent errors they have unit variance; those of calibration, shape and outline last,
    and add up as they do in a filter. NaN stays, and is left out elsewhere.
    """
    right = np.isfinite(white)
    window = np.ones(min(_LASTING, len(white)))
    sums, counts = (
        np.column_stack([np.convolve(column, window, "same") for column in values.T])
        for values in (np.where(right, white, 0.0), right.astype(float))
    )
    return np.where(right, sums / np.sqrt(np.maximum(counts, 1.0)), np.nan)


class TouchHistory:
    """Remembers the steps of a touch that a noise model is told of."""

    def __init__(self) -> None:
        self.end()

    def end(self) -> None:
        """Forget the touch: nothing was touched in this step."""
        self._last, self._velocity, self._since = np.zeros(2), np.zeros(2), 0.0

    def next(
        self, motion: PusherMotion, measured: MeasuredWrench | None, share: float, state: Array
    ) -> Touched | None:
        """One step (N = 1) of a touch by a tip; None where its force or its normal is not known.

        Args:
            motion: of the pusher.
            measured: its force.
            share: of the step's samples in which something was touched.
            state: (6 L,) of the object when the step begins, as far as is believed.
        """
        velocity = (motion.after - motion.before)[:2] / motion.step
        found = None
        if measured is not None and motion.normal is not None and not motion.grip:
            found = Touched(
                force=measured.value[None, :2],
                last=self._last[None],
                std=measured.std[:1],
                normal=motion.normal[None],
                velocity=velocity[None],
                before=self._velocity[None],
                slip=np.array([_slip(motion, state, motion.normal, velocity)]),
                since=np.array([self._since]),
                share=np.array([share]),
                step=np.array([motion.step]),
            )
        self._velocity, self._since = velocity, self._since + motion.step
        self._last = np.zeros(2) if measured is None else measured.value[:2]
        return found


def _slip(motion: PusherMotion, state: Array, normal: Array, velocity: Array) -> float:
    """Speed, m/s, at which the pusher slides along the touched link."""
    first = 6 * motion.link
    place, rates = state[first : first + 2], state[first + 3 : first + 6]
    arm = motion.before[:2] - place
    along = velocity - rates[:2] - rates[2] * np.array([-arm[1], arm[0]])
    return float(along[1] * normal[0] - along[0] * normal[1])
