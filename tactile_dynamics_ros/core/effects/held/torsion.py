"""Torsion of soft fingertips about the contact normals: they stick, slip or creep."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.geometry import contact_rate, torque_columns
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import register_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3

_SCREENED_SPINS = (0.05, 0.3, 2.0)
"""Spins w_0 of which the screening family holds a column each, rad/s. Mixtures of the three come
within 0.5 % (energy) of any w_0 from 0.01 to 10 on a motion that spins at 1 rad/s; two of them
leave up to 2 %, the middle one alone up to 20 %."""
_SLOWEST_SPIN = 0.01
"""Smallest w_0 that a fit can tell from a step, rad/s: the spin is slower in 0.5 % of the samples
of a motion at 1 rad/s. Smaller ones are evaluated as this one, with no derivative by w_0. Larger
hides values of w_0 that slower motions do show."""
_SCREENED_TWISTS = (0.03, 0.3, 3.0)
"""Twists, rad, up to which a finger sticks, of which the screening family of each finger holds a
column: 2 and 17 deg about enclose what soft tips show, 172 deg is a finger that never slips.
Without the last, fingers that only stick were not found; more cost a parameter of each finger."""
_HARDLY = 0.95
"""Limit from which a fit of fingers that only stick starts, over the torque of their largest twist:
they slip a little then, so that the fit sees what a limit does. Starts that slip more end beside
the solution, starts that never slip do not see the limit."""
_LEAST_TWIST = 0.02
"""Turn of a contact frame in the body from which spins relative to the fingers are read too, rad.
Frames of fingers that do not roll err by up to 0.007 in synthetic recordings; fingers that roll
turn by 0.6, a re-grasp by 0.3. Readings that cannot be told apart would only cost evidence. Lower
offers them for noise, far higher withholds them from fingers that roll."""
_PAUSE = 0.25
"""Step between samples, s, beyond which a twist is forgotten: nobody knows what happened within it,
and a finger that slips has its torque again after some tenths of a radian. Longer invents twist
across pauses, shorter forgets it at every lost message."""
_LEAST = 1e-6
"""Coefficient, m, and stiffness, N m/rad, that are evaluated at least: at zero their derivatives
vanish, and a fit would stay there. They make torques of 1e-5 N m at 10 N. Larger would hide weak
torsion, far smaller leave fits where they start."""


@register_effect
class ContactTorsion(Effect):
    """Soft fingertips resist spin about their normals, bounded by the normal force.

    Default: tau_i = -mu f_n tanh(w_n / w_0) n, w_n the spin about the normal n of the object, or
    relative to the finger; mu is a length. Reading `fingers` gives each its own coefficient.
    `sticks`: a twist is elastic up to the limit, then slips (Prandtl 1928):
    d tau_i / dt = -stiffness w_n while |tau_i| < torsion_i f_n. `viscous`: the slope does not
    follow the normal force: tau_i = -mu f_n tanh(k w_n / (mu f_n)) n. With `relative_` before it,
    a reading takes the spin relative to the fingers.
    """

    name = "contact_torsion"
    family = "contact"
    external = True
    formula = (
        "|tau_i| <= torsion_i f_n,i about the contact normal n_i, against the spin w_n,i: "
        "-torsion_i f_n,i tanh(w_n,i / w_0), or elastic (d tau_i = -stiffness w_n,i dt), then slip"
    )
    looks_like = "A torque residual about the contact normals against the spin, saturating early."
    sentence = "the soft fingertips resist being twisted about their normals"
    remedy = "Add it to the model; a harder tip or more fingers makes it smaller."

    _laws = ("", "viscous", "fingers", "sticks")
    _relative = "relative"

    def __init__(self, reading: str = "") -> None:
        """Choose the law and whose spin counts.

        Args:
            reading: empty, `viscous`, `fingers`, `sticks`, or `relative` (and `_` one of these).
        """
        self.reading = reading
        self._law_name = reading.removeprefix(self._relative).removeprefix("_")

    def with_reading(self, reading: str) -> Effect:
        """Return the reading of that name."""
        known = [*self._laws, *self._of_fingers()]
        if reading not in known:
            names = ", ".join(known[1:])
            raise BadInputError(f"effect '{self.name}' has no reading '{reading}': {names}")
        return ContactTorsion(reading)

    @classmethod
    def _of_fingers(cls) -> list[str]:
        """Readings with the spin relative to the fingers."""
        return ["_".join(filter(None, (cls._relative, law))) for law in cls._laws]

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """Spin relative to the fingers only where the contact frames turn in the body.

        With one contact, its own coefficient is the common one.
        """
        laws = [law for law in self._laws if law != "fingers" or len(samples.contact_names) > 1]
        still = np.abs(log_so3(_turned(samples))).max() < _LEAST_TWIST
        relative = [] if still else [r for r in self._of_fingers() if _law_of(r) in laws]
        return tuple(ContactTorsion(reading) for reading in (*laws, *relative))

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Coefficient of all or of each contact, and spin scale, viscosity or stiffness."""
        scale = EffectParameter("w_0", "rad/s", 3.0, "spin of half saturation", 0.3)
        if self._law_name == "":
            return (
                EffectParameter("mu", "m", 0.05, "torsional friction length", 0.004, least=0.0),
                scale,
            )
        if self._law_name == "viscous":
            return (
                EffectParameter("k", "N m s/rad", 0.1, "torsional viscosity", 0.004),
                EffectParameter("mu", "m", 0.3, "bound: torque per normal force", 0.02),
            )
        own = tuple(
            EffectParameter(f"torsion_{name}", "m", 0.05, f"friction length, {name}", 0.004 / k)
            for k, name in enumerate(samples.contact_names, start=1)
        )
        stiffness = EffectParameter("stiffness", "N m/rad", 1.0, "of the twist that sticks", 0.06)
        return (*own, stiffness if self._law_name == "sticks" else scale)

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Sum of the torques about the normals."""
        torque = self._torques(samples, theta)[..., 0]
        return self._about_normals(samples, torque[..., None])[..., 0]

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By all parameters."""
        return self._about_normals(samples, self._torques(samples, theta)[..., 1:])

    def _torques(self, samples: WrenchSamples, theta: Array) -> Array:
        """Torque about each normal and its derivatives by theta, (N, C, 1 + k)."""
        spin, force = self._spin(samples), _normal_force(samples)
        if self._law_name == "":
            return np.stack(_saturating(spin, force, theta), axis=2)
        if self._law_name == "viscous":
            return np.stack(_bounded_viscous(spin, force, theta), axis=2)
        count = force.shape[1]
        if self._law_name == "sticks":
            parts = _sticking(_twists(samples, spin), force, theta[:count], float(theta[-1]))
        else:
            found = [
                _saturating(spin[:, [k]], force[:, [k]], np.array([theta[k], theta[-1]]))
                for k in range(count)
            ]
            first, second, third = zip(*found, strict=True)
            parts = np.hstack(first), np.hstack(second), np.hstack(third)
        value, by_own, by_shared = parts
        own = by_own[:, :, None] * np.eye(count)
        return np.concatenate([value[..., None], own, by_shared[..., None]], axis=2)

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Saturation speeds, the viscous torque alone, or two laws of each finger."""
        spin, force = self._spin(samples), _normal_force(samples)
        if self._law_name == "viscous":
            return self._about_normals(samples, -spin[..., None])
        if self._law_name == "":
            laws = [-force * np.tanh(spin / scale) for scale in _SCREENED_SPINS]
            return self._about_normals(samples, np.stack(laws, axis=2))
        shapes = np.stack(self._shapes(samples, spin, force), axis=2)
        each = shapes[:, :, None, :] * np.eye(force.shape[1])[:, :, None]
        return self._about_normals(samples, each.reshape(*force.shape, -1))

    def _shapes(self, samples: WrenchSamples, spin: Array, force: Array) -> list[Array]:
        """Torques (N, C) of a coefficient of 1 m, of several spins or twists."""
        if self._law_name == "fingers":
            return [-force * np.tanh(spin / scale) for scale in _SCREENED_SPINS[:2]]
        twists, unit = _twists(samples, spin), np.ones(force.shape[1])
        usual = float(force[force > 0.0].mean()) if np.any(force > 0.0) else 1.0
        return [_sticking(twists, force, unit, usual / z)[0] for z in _SCREENED_TWISTS]

    def initial_guess(
        self, samples: WrenchSamples, inertia: Array, coefficients: Array, residual: Array
    ) -> Array:
        """The screened law that explains most of the residual torque."""
        if self._law_name == "viscous":
            return np.array([coefficients[0], 0.1])
        if self._law_name == "":
            basis = self.screening_basis(samples, inertia)[:, :3]
            share = np.einsum("nim,ni->m", basis, residual[:, :3])
            power = np.einsum("nim,nim->m", basis, basis)
            gain = share**2 / np.where(power > 0, power, 1.0)
            best = int(np.argmax(gain))
            return np.array([share[best] / max(power[best], 1e-30), _SCREENED_SPINS[best]])
        by_law = np.reshape(coefficients, (len(samples.contact_names), -1))
        if self._law_name == "fingers":
            best = int(np.argmax(np.abs(by_law).sum(axis=0)))
            return np.append(by_law.sum(axis=1), _SCREENED_SPINS[best])
        return self._guess_sticking(samples, by_law)

    def _guess_sticking(self, samples: WrenchSamples, by_law: Array) -> Array:
        """Start from the screened twist whose torques are largest.

        Args:
            samples: motion and contacts.
            by_law: (C, 3) coefficients of the torques of `_shapes`.
        """
        shapes = self._shapes(samples, self._spin(samples), _normal_force(samples))
        power = [np.sum((shape * by_law[:, k]) ** 2) for k, shape in enumerate(shapes)]
        best = int(np.argmax(power))
        force = _normal_force(samples)
        usual = float(force[force > 0.0].mean()) if np.any(force > 0.0) else 1.0
        own = np.maximum(by_law[:, best], 0.3 * np.abs(by_law[:, best]).mean())
        stiffness = max(usual * float(own.mean()) / _SCREENED_TWISTS[best], 1e-3)
        if best < len(_SCREENED_TWISTS) - 1:
            return np.append(own, stiffness)
        twists = np.nan_to_num(_twists(samples, self._spin(samples)))
        furthest = np.abs(np.cumsum(twists, axis=0)).max(axis=0)
        pressing = np.maximum(force.mean(axis=0), 1e-3)
        return np.append(_HARDLY * stiffness * furthest / pressing, stiffness)

    def _spin(self, samples: WrenchSamples) -> Array:
        """Spin of the object about each normal, rad/s, (N, C)."""
        normals = samples.contact_rotation[..., 2]
        rate = samples.angular_velocity[:, None]
        if self.reading.startswith(self._relative):
            rate = rate - contact_rate(samples)
        spin = np.einsum("nci,nci->nc", normals, np.broadcast_to(rate, normals.shape))
        return np.asarray(spin * samples.in_contact)

    def _about_normals(self, samples: WrenchSamples, torque: Array) -> Array:
        """Wrench columns (N, 6, m) of torques (N, C, m) about the normals."""
        normals = samples.contact_rotation[..., 2]
        return torque_columns(np.swapaxes(normals, 1, 2) @ torque)


def _law_of(reading: str) -> str:
    """The law of a reading, without whose spin it takes."""
    return reading.removeprefix("relative").removeprefix("_")


def _saturating(spin: Array, force: Array, theta: Array) -> tuple[Array, Array, Array]:
    """-mu f tanh(w / w_0) and its derivatives by mu and w_0."""
    scale = max(abs(float(theta[1])), _SLOWEST_SPIN)
    level = np.tanh(spin / scale)
    slope = np.sign(theta[1]) * float(abs(theta[1]) > _SLOWEST_SPIN)
    by_scale = theta[0] * force * (1.0 - level**2) * spin / scale**2 * slope
    return -theta[0] * force * level, -force * level, by_scale


def _bounded_viscous(spin: Array, force: Array, theta: Array) -> tuple[Array, Array, Array]:
    bound = np.maximum(abs(float(theta[1])) * force, 1e-9)
    ratio = theta[0] * spin / bound
    level = np.tanh(ratio)
    by_bound = (-level + ratio * (1.0 - level**2)) * force * np.sign(theta[1])
    return -bound * level, -spin * (1.0 - level**2), by_bound


def _twists(samples: WrenchSamples, spin: Array) -> Array:
    """Twist (N, C) since the sample before, rad; NaN where nobody knows it."""
    step = np.diff(samples.time, prepend=-np.inf)
    return np.asarray(np.where(step[:, None] > _PAUSE, np.nan, step[:, None] * spin))


def _sticking(
    twist: Array, force: Array, limits: Array, stiffness: float
) -> tuple[Array, Array, Array]:
    """Elastic torque that slips at its limit, and its derivatives by limit and stiffness.

    tau <- clip(tau - stiffness twist, ±limit f), zero where a recording or a contact begins.

    Args:
        twist: (N, C) rad since the sample before.
        force: (N, C) N, pressing.
        limits: (C,) m.
        stiffness: N m/rad.
    """
    size, sign = max(abs(stiffness), _LEAST), -1.0 if stiffness < 0.0 else 1.0
    columns = [
        _stick_and_slip(twist[:, k].tolist(), force[:, k].tolist(), max(abs(m), _LEAST), size)
        for k, m in enumerate(limits.tolist())
    ]
    value, by_limit, by_stiffness = np.transpose(np.array(columns), (2, 1, 0))
    small = np.abs(limits) < _LEAST
    share = np.where(small, limits / _LEAST, np.sign(limits))
    by_limit = np.where(small, value / _LEAST, by_limit)
    return value * share, by_limit, by_stiffness * share * sign


def _stick_and_slip(
    twists: list[float], forces: list[float], limit: float, stiffness: float
) -> list[tuple[float, float, float]]:
    """Torque and its derivatives by limit and stiffness at every sample of one contact."""
    torque = by_limit = by_stiffness = 0.0
    found = []
    for twist, force in zip(twists, forces, strict=True):
        if twist != twist:
            torque = by_limit = by_stiffness = 0.0
        else:
            torque, by_stiffness = torque - stiffness * twist, by_stiffness - twist
        bound = limit * force
        if torque >= bound:
            torque, by_limit, by_stiffness = bound, force, 0.0
        elif torque <= -bound:
            torque, by_limit, by_stiffness = -bound, -force, 0.0
        found.append((torque, by_limit, by_stiffness))
    return found


def _normal_force(samples: WrenchSamples) -> Array:
    """Pressing force of each contact, N, (N, C)."""
    along = np.einsum("nci,nci->nc", samples.contact_rotation[..., 2], samples.contact_force)
    return np.asarray(np.maximum(along, 0.0))


def _turned(samples: WrenchSamples) -> Array:
    """Rotation of the contact frames in the body since the first sample, (N, C, 3, 3)."""
    return samples.contact_rotation @ np.swapaxes(samples.contact_rotation[:1], 2, 3)
