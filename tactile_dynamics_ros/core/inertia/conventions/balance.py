"""How well a reading of a recording obeys Newton and Euler, by one cheap least squares.

Forces and torques of a few hundred instants are a body (ten numbers, one that can exist) and a bias
of the sensors (six numbers): w = Y phi + b. What is left is taken over what there was, so that
neither the unit of the forces nor noise that a reading makes larger can flatter it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.batch.prior import body_prior
from tactile_dynamics_ros.core.inertia.conventions.motions import Course, Motions
from tactile_dynamics_ros.core.inertia.residuals.motion import Motion
from tactile_dynamics_ros.core.numerics.least_squares import levenberg_marquardt
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_log_cholesky,
    log_cholesky_jacobian,
)
from tactile_dynamics_ros.core.rigid_body.rotation import skew
from tactile_dynamics_ros.core.streams.streams import (
    ContactStream,
    Streams,
    nearest_samples,
    places_at,
)

INSTANTS = 400
"""Instants at which readings are held against each other: 2400 equations for 16 numbers. Half as
many leave the ranking as it is; more cost time in proportion, for each of some 250 readings."""
_TOUCHING = 0.75
"""Periods of a contact's samples within which one must lie for it to count at an instant: half a
period is as far as an even stream is away, the rest is for jitter. Below half instants of touch are
lost; at 1 a contact counts for a period after it has let go."""
_ONLY_LEVER = 0.05
"""Lever, m, by which torques of one contact without torque are taken to be large, since its own are
zero: 5 cm, from a fingertip or palm to the middle of a hand's object. Readings are compared by the
same lever, so that it only decides what torques count in the first round: shorter trusts them more
than forces, longer less."""
_ROUNDS = 2
"""Fits in which forces and torques count by what the last one left of them. The first takes their
size for their error, the second what it left; each further one costs a search for each reading and
changes weights little. With one round torques that fit badly would bend the body as much as forces
that fit well."""
_LEAST_LEFT = 1e-6
"""Share of a signal that a reading leaves at least, so that exact data have a logarithm: a
hundredth of what the best sensors leave (1e-4). Smaller lets generated data without noise win by
rounding; above 1e-4 readings of good sensors would all look alike."""
_REACH = 12.0
"""Standard deviations of the prior to which the search is bounded: masses from 1e-20 to 1e20 of the
load, so that steps that diverge stay finite. At 3 a centre of mass could lie 1.5 m from the
contacts at most, nearer than readings of lengths in mm may ask for; at 200 exponentials
overflow."""
_ROUNDING = 1e-12
"""Added to information of unit diagonal, so that columns that say the same can be solved for: ten
thousand times the rounding of a number. Smaller leaves singular matrices of motions about one axis;
above 1e-6 it would act as a prior beside `_PRIOR_WEIGHT`."""
_STEPS = 25
"""Steps of the search for a body that can exist, at most. The search ends by itself where the error
falls no more (1e-6 of it). Fewer rank readings by unfinished searches; more cost time only for
readings whose search does not end."""
_PRIOR_WEIGHT = 1e-6
"""Share of the information of the data by which the body is held at a common one, so that what the
motion does not show stays finite. Much larger it bends bodies that data do show; at zero `_REACH`
alone would bound them, and such bodies look implausible."""
_LIGHTEST, _HEAVIEST = 0.01, 30.0
"""Masses between which nothing speaks against a reading, kg: what hands and arms carry. Wider
bounds no longer tell a kilogram from a gram in recordings that both fit, narrower ones speak
against true readings of light or heavy objects, by `_IMPLAUSIBLE` for each factor of e."""
_FARTHEST = 0.5
"""Distance of the centre of mass from the contacts up to which nothing speaks against it, m: half
of a rod of 1 m that is held at its end. Shorter speaks against long tools, longer lets positions in
cm or mm pass that place the centre metres away."""
_THINNEST, _WIDEST = 2e-3, 0.5
"""Radii of gyration between which nothing speaks against a reading, m: those of a bead of 6 mm and
of a rod of 1.7 m. Wider bounds tell fewer units of length apart, narrower ones speak against true
readings of small or long objects."""
_IMPLAUSIBLE = 0.1
"""What a factor of e beyond these bounds counts, in logarithms of what is left: readings that fit
as well are told apart by it, ones that fit worse by 10 % are not. At zero equal fits are told apart
by chance; at 1 a body twice beyond a bound outweighs a fit that is better by half."""


@dataclass(frozen=True)
class Balance:
    """What a reading leaves.

    Attributes:
        left: logarithm of what is left over what there was, RMS, by channel: force, torque, and
            of an IMU beside poses acceleration and angular velocity.
        implausible: what speaks against the body, in the same units; 0 mostly.
        rows: equations behind each channel.
    """

    left: dict[str, float]
    implausible: float
    rows: int

    @property
    def score(self) -> float:
        """Sum of what is left and what speaks against it; lower is better."""
        return sum(self.left.values()) + self.implausible


def thinned(streams: Streams, count: int = INSTANTS) -> Streams:
    """Streams whose contacts have samples at the same few instants only.

    Args:
        streams: measurements with contacts that overlap the motion.
        count: instants.
    """
    longest = max(streams.contacts.values(), key=lambda contact: len(contact.time))
    spans = [s.time for s in (streams.pose, streams.imu) if s is not None]
    inside = np.all([(longest.time >= t[0]) & (longest.time <= t[-1]) for t in spans], axis=0)
    stamps = longest.time[inside]
    if len(stamps) > count:
        stamps = stamps[np.linspace(0, len(stamps) - 1, count).astype(int)]
    contacts = {name: _thinned(contact, stamps) for name, contact in streams.contacts.items()}
    return replace(streams, contacts=contacts)


def _thinned(contact: ContactStream, stamps: Array) -> ContactStream:
    nearest = nearest_samples(contact.time, stamps)
    period = float(np.median(np.diff(contact.time))) if len(contact.time) > 1 else 0.0
    touching = np.abs(contact.time[nearest] - stamps) <= _TOUCHING * period
    place, rotation = places_at(contact.pose_time, contact.position, contact.rotation, stamps)
    std = contact.force_std
    return replace(
        contact,
        time=stamps,
        force=contact.force[nearest] * touching[:, None],
        torque=contact.torque[nearest] * touching[:, None],
        force_std=None if std is None else std[nearest],
        pose_time=stamps,
        position=place,
        rotation=rotation,
    )


@dataclass(frozen=True)
class Evidence:
    """What one reading makes of forces, torques and motion.

    Attributes:
        course: the motion.
        wrench: (M, 6) what the contacts transmit, body axes, where the motion is known.
        levers: (M, 3) middle of the contacts, body axes, m.
        signal: (2,) RMS of the torques, N m, and of the forces, N, of single contacts.
        of_imu: what the poses leave of the IMU's readings, by channel.
    """

    course: Course
    wrench: Array
    levers: Array
    signal: Array
    of_imu: dict[str, float]

    @classmethod
    def of(cls, streams: Streams, motions: Motions) -> Evidence | None:
        """Evidence of streams whose contacts share their stamps; None where they show none."""
        stamps = next(iter(streams.contacts.values())).time
        course = motions.read(streams, stamps)
        valid = course.valid
        if valid.sum() < len(stamps) // 4:
            return None
        wrench, levers, squares = _wrench(streams, course.motion)
        signal = np.sqrt(squares[valid].mean(axis=0) / 3.0)
        of_imu = _left_of_imu(streams, stamps, motions)
        return cls(course, wrench[valid], levers[valid], signal, of_imu)

    def weigh(self, disturbed: bool = False, enough: float = np.inf) -> Balance | None:
        """What is left; None where nothing is to be seen.

        Args:
            disturbed: whether other forces and torques than the load's are admitted.
            enough: score from which upwards nobody asks: where numbers that need not be a body
                leave as much, None is returned without a search for one that can exist.
        """
        load = self.course.load
        beside = self.course.disturbances if disturbed else load[..., :0]
        system = System.of(load, beside, self.wrench, self.levers, self.signal)
        if system is None or system.least() + sum(self.of_imu.values()) > enough:
            return None
        left, implausible = system.fit()
        return Balance(left | self.of_imu, implausible, 3 * len(self.wrench))


def _left_of_imu(streams: Streams, stamps: Array, motions: Motions) -> dict[str, float]:
    imu = streams.imu
    if imu is None or streams.pose is None:
        return {}
    by_pose, by_imu = (
        motions.read(replace(streams, imu=None), stamps),
        motions.read(streams, stamps),
    )
    used = by_pose.valid & by_imu.valid
    seen = by_imu.specific_force[used]
    found = {"acceleration": _share_left(seen - by_pose.specific_force[used], seen)}
    if imu.angular_velocity is not None:
        rate = by_imu.motion.angular_velocity_B[used]
        found["rate"] = _share_left(rate - by_pose.motion.angular_velocity_B[used], rate)
    return found


def _share_left(left: Array, signal: Array) -> float:
    size = float(np.sqrt(np.mean(signal**2)))
    centred = left - left.mean(axis=0)
    return float(np.log(max(np.sqrt(np.mean(centred**2)) / max(size, 1e-300), _LEAST_LEFT)))


def net_force(streams: Streams) -> Array:
    """Sum (N, 3) of the forces of contacts that share their stamps, world axes."""
    return np.asarray(np.sum([contact.force for contact in streams.contacts.values()], axis=0))


def _wrench(streams: Streams, motion: Motion) -> tuple[Array, Array, Array]:
    """What the contacts transmit, body axes.

    Returns:
        Wrench (N, 6) about the origin, middle (N, 3) of the contacts, and (N, 2) the squares of
        what single contacts transmit: torques, those of forces about the middle included, and
        forces. Turning the forces of a hand changes neither; their sum would grow by its squeeze.
    """
    to_body = np.swapaxes(motion.rotation, 1, 2)
    wrench, count = np.zeros((len(to_body), 6)), len(streams.contacts)
    forces, torques, levers = [], [], []
    for contact in streams.contacts.values():
        force, torque, lever = (
            (to_body @ v[..., None])[..., 0]
            for v in (contact.force, contact.torque, contact.position - motion.position)
        )
        wrench[:, :3] += np.cross(lever, force) + torque
        wrench[:, 3:] += force
        forces.append(np.sum(force**2, axis=1))
        torques.append(np.sum(torque**2, axis=1))
        levers.append(lever)
    middle = np.mean(levers, axis=0)
    spread = np.sum((np.array(levers) - middle) ** 2, axis=2)
    if count == 1 and not np.any(torques):
        spread = spread + _ONLY_LEVER**2
    squares = np.stack([np.sum(torques + spread * forces, axis=0), np.sum(forces, axis=0)], axis=1)
    return wrench, middle, squares


@dataclass(frozen=True)
class System:
    """Equations w = Y phi + D d + b of forces and torques about the middle of the contacts.

    Attributes:
        squares: (2, n, n) products of the columns [Y, D, 1, w] summed over torques and over forces.
        signal: (2,) RMS of the torques, N m, and of the forces, N, of single contacts.
        rows: numbers behind each.
        lever: (3,) middle of the contacts, body frame, m.
        load: median force, N.
    """

    squares: Array
    signal: Array
    rows: int
    lever: Array
    load: float

    @classmethod
    def of(
        cls, rows: Array, beside: Array, wrench: Array, levers: Array, signal: Array
    ) -> System | None:
        """The system of a body; None of forces that are zero.

        Args:
            rows: (N, 6, 10) regressors Y of the body.
            beside: (N, 6, m) columns D of what else may act.
            wrench: (N, 6) w.
            levers: (N, 3) middle of the contacts, body frame, m.
            signal: (2,) RMS of the torques and forces of single contacts.
        """
        lever = levers.mean(axis=0)
        shift = np.eye(6)
        shift[:3, 3:] = -skew(lever)
        seen = wrench @ shift.T
        if not np.all(np.isfinite(signal)) or not np.all(signal > 0.0):
            return None
        bias = np.broadcast_to(np.eye(6), (len(rows), 6, 6))
        columns = np.concatenate([shift @ rows, shift @ beside, bias, seen[..., None]], axis=2)
        size = columns.shape[2]
        parts = (columns[:, :3].reshape(-1, size), columns[:, 3:].reshape(-1, size))
        squares = np.stack([part.T @ part for part in parts])
        load = float(np.median(np.linalg.norm(seen[:, 3:], axis=1)))
        return cls(squares, signal, 3 * len(rows), lever, load)

    def least(self) -> float:
        """Sum of the logarithms that any numbers leave at least, a body or not."""
        share, _ = self._rounds(possible=False)
        return float(share.sum())

    def fit(self) -> tuple[dict[str, float], float]:
        """Logarithms of what is left by a body that can exist, and what speaks against it."""
        share, phi = self._rounds(possible=True)
        left = {"torque": float(share[0]), "force": float(share[1])}
        return left, _implausible(phi, self.lever)

    def _rounds(self, possible: bool) -> tuple[Array, Array]:
        left = self.signal.copy()
        x = np.zeros(len(self.squares[0]))
        for _ in range(_ROUNDS):
            joined = np.tensordot(
                np.maximum(left, _LEAST_LEFT * self.signal) ** -2.0, self.squares, 1
            )
            x = self._solve(joined, possible)
            squares = np.einsum("i,kij,j->k", x, self.squares, x)
            left = np.sqrt(np.maximum(squares, 0.0) / self.rows)
        return np.log(np.maximum(left / self.signal, _LEAST_LEFT)), -x[:10]

    def _solve(self, joined: Array, possible: bool) -> Array:
        """The combination (n,) of the columns, one of the last, with the least square."""
        information, aim = joined[:-1, :-1], joined[:-1, -1]
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        alike = information / np.outer(scale, scale) + _ROUNDING * np.eye(len(aim))
        if not possible:
            return np.append(-np.linalg.solve(alike, aim / scale) / scale, 1.0)
        across = np.linalg.solve(alike[10:, 10:], alike[10:])
        own = (alike[:10, :10] - alike[:10, 10:] @ across[:, :10]) * np.outer(
            scale[:10], scale[:10]
        )
        beside = np.linalg.solve(alike[10:, 10:], (aim / scale)[10:])
        wanted = aim[:10] - scale[:10] * (alike[:10, 10:] @ beside)
        phi = _possible(own, wanted, self.lever, self.load)
        bias = (beside - across[:, :10] @ (scale[:10] * phi)) / scale[10:]
        return np.concatenate([-phi, -bias, [1.0]])


def _possible(information: Array, aim: Array, lever: Array, load: float) -> Array:
    """The parameters (10,) of a body that can exist with the least phi^T H phi - 2 a^T phi."""
    prior = body_prior(max(load / 9.81, 1e-6), lever[None], single=True)
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * scale
    inverse = np.where(values > 1e-12, 1.0 / np.sqrt(np.maximum(values, 1e-12)), 0.0)
    wanted = inverse * (vectors.T @ (aim / scale))
    hold = np.sqrt(_PRIOR_WEIGHT * max(float(wanted @ wanted), 1e-12)) / prior.std

    reach = _REACH * prior.std

    def bounded(xi: Array) -> Array:
        return np.asarray(prior.mean + np.clip(xi - prior.mean, -reach, reach))

    def evaluate(xi: Array) -> tuple[Array, Array]:
        xi = bounded(xi)
        phi = dynamic_parameters_from_log_cholesky(xi)
        residual = np.concatenate([root @ phi - wanted, hold * (xi - prior.mean)])
        return residual, np.concatenate([root @ log_cholesky_jacobian(xi), np.diag(hold)])

    xi, _ = levenberg_marquardt(evaluate, prior.mean, _STEPS, 1e-6)
    return dynamic_parameters_from_log_cholesky(bounded(xi))


def _implausible(phi: Array, lever: Array) -> float:
    """What speaks against a body: its mass, centre and size beyond what hands and arms carry."""
    mass = max(float(phi[0]), 1e-12)
    centre = phi[1:4] / mass
    inertia = phi[4] + phi[6] + phi[9] - 2.0 * mass * float(centre @ centre)
    radius = float(np.sqrt(max(inertia, 1e-18) / (2.0 * mass)))
    away = max(float(np.linalg.norm(centre - lever)), 1e-12)
    beyond = [
        np.log(mass / _HEAVIEST), np.log(_LIGHTEST / mass), np.log(away / _FARTHEST),
        np.log(radius / _WIDEST), np.log(_THINNEST / radius),
    ]  # fmt: skip
    return _IMPLAUSIBLE * float(sum(max(value, 0.0) for value in beyond))
