"""Whether two parts are one rigid body, turn about a joint, or are separate, by their motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from scipy.special import logsumexp

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.bordered import NormalEquations, minimise
from tactile_dynamics_ros.core.planar.linked.chances import Chances
from tactile_dynamics_ros.core.planar.linked.outlines import RelativePoses
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned

STRUCTURES = ("rigid", "jointed", "separate")
"""What two parts may be to each other, in the order of arrays of this module."""
DECIDED = 0.95
"""Probability from which a structure is reported: one in twenty of such answers may be wrong. Below
it the answer is "undecided"."""
_TURNS = np.radians((1.0, 3.0, 10.0, 30.0, 90.0))
"""How far a joint turns over a recording, rad, each as likely as the next; half a degree is not
told from rest. More of them change the evidence by less than 1."""
_DRIFTS = ((2e-3, 0.03), (1e-2, 0.2), (5e-2, 1.0))
"""How far separate parts move beside each other over a recording, m and rad, each as likely."""
_STILL = (1e-6, 1e-6, 1e-6)
"""The same of a rigid pair, m, m, rad: far below all noise, yet no division by zero."""
_REACH = 0.3
"""Std of a joint's place over the size of both parts, before the motion: it lies between them or on
a handle beside them. Twice as wide halves the probability of joints."""
_TURN_PRIOR = 2.0
"""Std of the first relative yaw, rad: any. It is the same in all structures and drops out."""
_LOOSE_TURNS = np.radians((3.0, 30.0))
"""How far a joint with play turns, rad, likewise; all of `_TURNS` take twice as long and change the
evidence by less than 1."""
_PLAYS = (5e-4, 1e-3, 1.5e-3, 2e-3, 3e-3, 5e-3)
"""Radii of play that are weighed, m, each as likely as the next: less hides in the noise of poses,
more is a chain. A finer grid changes the play by a tenth of itself."""
_PLAY_LASTS = (0.1, 0.4)
"""Shares of all travel over which the pin stays where it lies in its hole, each as likely: a part
of a push, or all pushes of one way. At 0.02 and 1.5 evidence falls by 20."""
_WALL = 0.3
"""Std of how far a pin is found beyond its wall, over the play: noise of poses. Without a wall a
pin wanders off by centimetres, as separate parts do; at a tenth play comes out too large."""
_PLAY_DOUBT = 0.5
"""Relative std of a play beside what the grid leaves open: few pushes press the pin against few
walls, and the joint's place takes up their mean. Of 4 mm two pushes showed 1.9."""
_SLACK = 5.0
"""Log evidence by which a joint with play has to beat one without, and a rigid pair: one in 150."""
_ALIKE = 0.25
"""Log evidence per relative pose by which separate parts may be likelier than a joint with play and
still be no better: that a pin jumps from wall to wall neither has. On joints made for tuning it was
up to 0.20, where a part stays behind 0.5 and more."""
_HOPELESS = 20.0
"""Log evidence by which a turn may be less likely than the best and still be refined: the volume of
angles moves it by less than 5."""
_VOLUME_ROUNDS, _VOLUME_STEP = 3, 1e-3
"""Fits of a joint with a new slope of the volume of angles, and the distance of its difference
quotient, m; after three the place moves by a tenth of its std."""
_ITERATIONS, _TOLERANCE = 40, 1e-3
"""Steps of the fit of a joint at most, and the fall of its cost at which it ends; 5 to 10 suffice
from the place between the parts."""


@dataclass(frozen=True, eq=False)
class Hinge:
    """Where a joint lies, if there is one.

    Attributes:
        first, second: (2,) m in each part's frame. covariance: (4, 4) of both, m^2.
        turned: rad, between its extremes.
        play: m, radius by which the pin is thinner than its hole, and its std; zero if it fits.
    """

    first: Array
    second: Array
    covariance: Array
    turned: float
    play: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Structure:
    """What two parts are to each other.

    Attributes:
        probability: by `STRUCTURES`. hinge: where a joint lies, should there be one.
        offset: (3,) m, m, rad, mean pose of the second part in the first one's frame.
        slack: a joint with play that the model lacks and the motion shows, or None.
    """

    probability: dict[str, float]
    hinge: Hinge
    offset: Array
    slack: Hinge | None = None

    @property
    def name(self) -> str:
        """The likeliest structure, or "undecided"."""
        best = self.likeliest
        return best if self.probability[best] >= DECIDED else "undecided"

    @property
    def likeliest(self) -> str:
        """The likeliest structure, decided or not."""
        return max(self.probability, key=lambda n: self.probability[n])


def infer_structure(
    poses: RelativePoses, between: Array, size: float, chances: Chances, loose: bool = False
) -> Structure:
    """Weigh the three structures by how well and how easily each explains the relative motion.

    Args:
        poses: of the second part in the first one's frame.
        between: (2, 2) m, the place between the outlines in each part's frame.
        size: m, of both parts together.
        chances: of each structure before the motion, and of looking rigid though it is not.
        loose: whether the joint may have play.
    """
    spread = _REACH * size
    still = _free_evidence(poses, between, spread, np.array(_STILL))
    moving = [_free_evidence(poses, between, spread, np.array([d, d, a])) for d, a in _DRIFTS]
    hinges = [_Hinged(poses, between, spread, scale) for scale in _TURNS]
    best = max(still, *(hinge.evidence for hinge in hinges))
    for hinge in hinges:
        if hinge.evidence > best - _HOPELESS:
            hinge.refine()
    plays = _with_play(poses, between, spread)
    loosely = _mean([hinge.evidence for hinge in plays])
    tight = max(still, *(hinge.evidence for hinge in hinges))
    doubt = _ALIKE * len(poses.value)
    slack = loosely > max(tight + _SLACK, max(moving) - doubt) and not loose
    if loose:
        moving = [evidence - doubt for evidence in moving]
    elif slack and max(moving) > loosely - _SLACK:
        moving = [evidence + loosely - max(moving) for evidence in moving]
    if loose or slack:
        hinges = [*hinges, *plays]
    turning = [hinge.evidence for hinge in hinges]
    separate = _mixed(chances.carried, still, _mean(moving))
    jointed = _mixed(chances.stuck, still, _mean(turning))
    log = np.array([still, jointed, separate]) + np.log(chances.prior)
    weight = np.exp(log - logsumexp(log))
    return Structure(
        dict(zip(STRUCTURES, (float(w) for w in weight), strict=True)),
        _averaged(hinges),
        poses.value.mean(axis=0),
        _averaged(plays) if slack else None,
    )


def _with_play(poses: RelativePoses, between: Array, spread: float) -> list[_Hinged]:
    """Joints that turn little or much and have a play."""
    return [
        _Hinged(poses, between, spread, scale, play, lasts)
        for play, scale, lasts in product(_PLAYS, _LOOSE_TURNS, _PLAY_LASTS)
    ]


def _mixed(chance: float, looks_rigid: float, moves: float) -> float:
    """Evidence of a structure that looks rigid with a chance, and else moves."""
    return float(np.logaddexp(np.log(chance) + looks_rigid, np.log1p(-chance) + moves))


def _mean(evidence: list[float]) -> float:
    return float(logsumexp(evidence) - np.log(len(evidence)))


def _averaged(hinges: list[_Hinged]) -> Hinge:
    """The place of the joint, averaged over how far it turns."""
    log = np.array([hinge.evidence for hinge in hinges])
    weight = np.exp(log - logsumexp(log))
    place = np.sum([w * h.place for w, h in zip(weight, hinges, strict=True)], axis=0)
    covariance = np.zeros((4, 4))
    for w, hinge in zip(weight, hinges, strict=True):
        away = hinge.place - place
        covariance += w * (hinge.covariance + np.outer(away, away))
    angle = hinges[int(np.argmax(weight))].angle
    plays = np.array([hinge.play for hinge in hinges])
    play = float(weight @ plays)
    doubt = float(np.sqrt(weight @ (plays - play) ** 2 + (_PLAY_DOUBT * play) ** 2))
    return Hinge(place[:2], place[2:], covariance, float(np.ptp(angle)), (play, doubt))


def _whitening(poses: RelativePoses) -> tuple[Array, float]:
    """Inverse Cholesky factors (B, 3, 3) of the noise, and half its log determinant."""
    factor = np.linalg.cholesky(poses.covariance)
    logarithm = float(np.sum(np.log(np.diagonal(factor, axis1=1, axis2=2))))
    return np.linalg.inv(factor), logarithm


def _add_walk(
    equations: NormalEquations, nodes: Array, travel: Array, scale: Array, start: Array
) -> float:
    """Add a random walk from N(start, .) and return its half logarithm of determinants.

    Args:
        equations: to add to.
        nodes: (B, b).
        travel: (B - 1,) share of the variance of each step.
        scale: (b,) std of the whole walk.
        start: (2, b) mean and std of the first node.
    """
    count, size = nodes.shape
    std = scale * np.sqrt(travel)[:, None]
    by_nodes = np.zeros((count - 1, size, 3, equations.size))
    axes = np.arange(size)
    by_nodes[:, axes, 0, axes] = -1.0 / std
    by_nodes[:, axes, 1, axes] = 1.0 / std
    equations.add(np.arange(1, count), np.diff(nodes, axis=0) / std, by_nodes)
    first = np.zeros((1, size, 3, equations.size))
    first[:, axes, 1, axes] = 1.0 / start[1]
    equations.add(np.array([0]), (nodes[:1] - start[0]) / start[1], first)
    return float(np.sum(np.log(std)) + np.sum(np.log(start[1])))


def _add_slack(equations: NormalEquations, slack: Array, travel: Array, play: float) -> float:
    """Add where a pin lies in its hole (B, 2), and return its half logarithm of determinants.

    s_k+1 = rho s_k + sigma sqrt(1 - rho^2) w, sigma = p / sqrt(2): mostly at the wall, any way.
    """
    spread = play / np.sqrt(2.0)
    keep = np.exp(-travel)
    std = spread * np.sqrt(1.0 - keep**2)
    axes = np.arange(2)
    by_nodes = np.zeros((len(keep), 2, 3, equations.size))
    by_nodes[:, axes, 0, 1 + axes] = -(keep / std)[:, None]
    by_nodes[:, axes, 1, 1 + axes] = (1.0 / std)[:, None]
    residual = (slack[1:] - keep[:, None] * slack[:-1]) / std[:, None]
    equations.add(np.arange(1, len(slack)), residual, by_nodes)
    first = np.zeros((1, 2, 3, equations.size))
    first[:, axes, 1, 1 + axes] = 1.0 / spread
    equations.add(np.array([0]), slack[:1] / spread, first)
    return float(2.0 * np.sum(np.log(std)) + 2.0 * np.log(spread))


def _free_evidence(poses: RelativePoses, between: Array, spread: float, scale: Array) -> float:
    """Logarithm of the evidence of relative poses that walk by a scale (3,) m, m, rad."""
    white, volume = _whitening(poses)
    first = poses.value[0]
    arms = turned(between[1][None], first[2:])[0]
    mean = np.array([*(between[0] - arms), first[2]])
    start = np.stack([mean, np.array([np.sqrt(2.0) * spread] * 2 + [_TURN_PRIOR])])
    nodes = np.tile(np.average(poses.value, axis=0), (len(poses.value), 1))
    by_nodes = np.zeros((len(nodes), 3, 3, 3))
    by_nodes[:, :, 1] = white

    def linearise(at: Array, common: Array) -> NormalEquations:
        equations = NormalEquations(len(at), 3, 1)
        residual = (white @ (at - poses.value)[..., None])[..., 0]
        equations.add(np.arange(len(at)), residual, by_nodes)
        equations.add_common(common, np.ones((1, 1)))
        volumes.append(_add_walk(equations, at, poses.travel, scale, start))
        return equations

    volumes: list[float] = []
    equations = linearise(nodes, np.zeros(1))
    step, _ = equations.factor(np.zeros(nodes.shape), np.zeros(1)).step()
    best = linearise(nodes + step, np.zeros(1))
    determinant = best.factor(np.zeros(nodes.shape), np.zeros(1)).log_determinant
    return -0.5 * (best.cost + determinant) - volumes[-1] - volume


class _Hinged:
    """A joint that turns by a scale, rad, with a play, m: its evidence and its place.

    Nodes are the angle and, with play, where the pin lies in its hole.
    """

    def __init__(
        self,
        poses: RelativePoses,
        between: Array,
        spread: float,
        scale: float,
        play: float = 0.0,
        lasts: float = 1.0,
    ) -> None:
        self._poses, self._scale, self.play, self._lasts = poses, scale, play, lasts
        self._mean, self._spread = between.ravel(), spread
        self._white, volume = _whitening(poses)
        self._volume = 0.0
        self._noise_volume = volume
        self.nodes, self.place = poses.value[:, 2:].copy(), self._mean.copy()
        if play:
            self.nodes = np.column_stack([self.nodes, np.zeros((len(self.nodes), 2))])
        self._fit(None)

    @property
    def angle(self) -> Array:
        """(B,) rad."""
        return np.asarray(self.nodes[:, 0])

    def refine(self) -> None:
        """Correct the place by the volume of angles that fit."""
        for _ in range(_VOLUME_ROUNDS):
            self._fit(self._volume_slope(self.nodes, self.place))

    def _fit(self, slope: Array | None) -> None:
        linearise = partial(self._linearise, slope=slope)
        scales = np.array([0.01, 1e-3, 1e-3][: self.nodes.shape[1]]), np.full(4, 0.01)
        found = minimise(linearise, self.nodes, self.place, *scales, _ITERATIONS, _TOLERANCE)
        self.nodes, self.place = found.nodes, found.common
        equations = self._linearise(self.nodes, self.place)
        factor = equations.factor(np.zeros(self.nodes.shape), np.zeros(4))
        volume = self._volume + self._noise_volume + 4.0 * float(np.log(self._spread))
        self.evidence = -0.5 * (equations.cost + factor.log_determinant) - volume
        if self.play:
            beyond = np.linalg.norm(self.nodes[:, 1:], axis=1) - self.play
            beyond = np.maximum(beyond, 0.0) / (_WALL * self.play)
            self.evidence -= 0.5 * float(beyond @ beyond)
        self.covariance = factor.covariance

    def _volume_slope(self, nodes: Array, common: Array) -> Array:
        """Slope (4,) of the volume of angles that fit, which the likeliest angles leave out.

        Without it a joint that hardly turns is seen far away, where small angles fit the noise.
        """
        none = np.zeros(nodes.shape)

        def volume(shift: Array) -> float:
            found = self._linearise(nodes, common + shift)
            return found.log_determinant_of_nodes(none, nodes.shape[1])

        steps = np.eye(4) * _VOLUME_STEP
        return np.array([-(volume(s) - volume(-s)) / (4.0 * _VOLUME_STEP) for s in steps])

    def _linearise(
        self, nodes: Array, common: Array, slope: Array | None = None
    ) -> NormalEquations:
        poses, angle = self._poses, nodes[:, 0]
        arm = turned(np.broadcast_to(common[2:], (len(nodes), 2)), angle)
        slack = nodes[:, 1:] if self.play else 0.0
        expected = np.column_stack([common[:2] - arm + slack, angle])
        residual = (self._white @ (expected - poses.value)[..., None])[..., 0]
        by_angle = np.column_stack([arm[:, 1], -arm[:, 0], np.ones(len(nodes))])
        by_nodes = np.zeros((len(nodes), 3, 3, nodes.shape[1]))
        by_nodes[:, :, 1, :1] = self._white @ by_angle[..., None]
        by_nodes[:, :, 1, 1:] = self._white[:, :, : nodes.shape[1] - 1]
        cos, sin = np.cos(angle), np.sin(angle)
        by_place = np.zeros((len(nodes), 3, 4))
        by_place[:, [0, 1], [0, 1]] = 1.0
        by_place[:, 0, 2:] = np.column_stack([-cos, sin])
        by_place[:, 1, 2:] = np.column_stack([-sin, -cos])
        equations = NormalEquations(len(nodes), nodes.shape[1], 4)
        equations.add(np.arange(len(nodes)), residual, by_nodes, self._white @ by_place)
        equations.add_common((common - self._mean) / self._spread, np.eye(4) / self._spread)
        start = np.array([[poses.value[0, 2]], [_TURN_PRIOR]])
        if slope is not None:
            equations.add_slope(slope, common)
        scale = np.array([self._scale])
        self._volume = _add_walk(equations, nodes[:, :1], poses.travel, scale, start)
        if self.play:
            self._volume += _add_slack(
                equations, nodes[:, 1:], poses.travel / self._lasts, self.play
            )
        return equations
