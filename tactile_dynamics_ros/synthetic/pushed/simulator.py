"""Objects that are pushed and pulled over a table: many scenes at once, implicit in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.synthetic.pushed.bodies import Bodies, cross, rotation
from tactile_dynamics_ros.synthetic.pushed.friction_field import FrictionField, friction_factor
from tactile_dynamics_ros.synthetic.pushed.implicit import Step
from tactile_dynamics_ros.synthetic.pushed.pusher import Pushers
from tactile_dynamics_ros.synthetic.pushed.scene import STEP, BodyState, Scene

_REFRESH = 5
"""Steps after which friction is looked up anew: 1.5 mm of travel at 300 mm/s, far less than the
distance over which it changes."""


@dataclass(frozen=True)
class Motion:
    """What happened in one scene, at every step of the physical clock.

    Attributes:
        time: (K,) s.
        origin: (K, L, 2) m and angle: (K, L) rad of the links' frames.
        pusher: (K, 3) x, y, yaw of tip or gripper.
        contact: (K, C) which contacts touch: pusher, pad_left, pad_right.
        point: (K, C, 2) m. normal: (K, C, 2) into the object. force: (K, C, 2) N on the object.
        touched: (K,) index of the link.
        work: (K,) J done on the object by contacts since the start. lost: (K,) J lost to friction
        of the table, of the joint and by viscosity. kinetic: (K,) J.
    """

    time: np.ndarray
    origin: np.ndarray
    angle: np.ndarray
    pusher: np.ndarray
    contact: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    force: np.ndarray
    touched: np.ndarray
    work: np.ndarray
    lost: np.ndarray
    kinetic: np.ndarray


def simulate(scenes: Sequence[Scene], step: float = STEP) -> list[Motion]:
    """Simulate scenes whose objects have as many links; the longest decides the time that it takes.

    Args:
        scenes: with paths at this step.
        step: s.
    """
    return Simulation(scenes, step).run()


class Simulation:
    """State of all scenes and how it goes on."""

    def __init__(self, scenes: Sequence[Scene], step: float = STEP) -> None:
        self._scenes, self._h = list(scenes), step
        self.bodies = Bodies([scene.thing for scene in scenes])
        self.pushers = Pushers(scenes, step)
        b, links = len(scenes), self.bodies.links
        self._u = np.zeros((b, self.bodies.freedoms))
        self._sense = np.zeros((b, self.bodies.rubbing, 2))
        self._gravity = np.array([scene.gravity for scene in scenes])
        self._limit_factor = np.ones((b, self.bodies.feet_count))
        self._horizontal = np.zeros((b, links, 2))
        self._work, self._lost = np.zeros(b), np.zeros(b)
        self._read_table(scenes)

    def _read_table(self, scenes: Sequence[Scene]) -> None:
        def column(name: str) -> np.ndarray:
            return np.array([getattr(scene, name) for scene in scenes], dtype=float)

        self._stretch, self._viscosity = column("stretch"), column("viscosity")
        self._weakening, self._weakening_speed = column("weakening"), column("weakening_speed")
        self._stiction, self._stiction_speed = column("stiction"), column("stiction_speed")
        self._isotropic = bool(np.all(self._stretch == np.eye(2)))
        fields = [scene.field or FrictionField.even() for scene in scenes]
        self._cells = np.stack([field.cells for field in fields])
        self._gradient = np.stack([field.gradient for field in fields])
        self._uneven = bool(self._cells.any() or self._gradient.any())
        self._by_speed = bool(self._weakening.any() or self._stiction.any())

    def run(self) -> list[Motion]:
        """Return what happened in all scenes."""
        steps = max(scene.steps for scene in self._scenes)
        rows = [self._advance(k) for k in range(steps)]
        columns = [np.stack(column, axis=1) for column in zip(*rows, strict=True)]
        time = np.arange(1, steps + 1) * self._h
        return [
            Motion(time[: scene.steps], *(column[b, : scene.steps] for column in columns))
            for b, scene in enumerate(self._scenes)
        ]

    def _advance(self, k: int) -> tuple[np.ndarray, ...]:
        """Go on by one step; return a row of each column of `Motion`."""
        bodies, h = self.bodies, self._h
        self._change(k * h)
        self.pushers.begin(k, bodies)
        G = bodies.velocities(bodies.feet)
        Gc = bodies.velocities(bodies.com[:, :, None])[:, :, 0]
        force, moment, load, place = self._influences(k * h)
        limit = self._limits(k, load, place)
        mass = np.einsum("blkd,bl,blke->bde", Gc, bodies.mass, Gc) + bodies.turning()
        momentum = np.einsum("blkd,bl,blk->bd", Gc, bodies.mass, bodies.com_velocity)
        momentum += bodies.turning_momentum()
        weight = bodies.mass[:, :, None] * self._gravity[:, None, :2]
        momentum += h * np.einsum("blkd,blk->bd", Gc, weight)
        momentum[:, :2] += h * force
        momentum[:, 2] += h * moment
        viscous = self._add_viscosity(mass, G)
        if bodies.freedoms > 4:
            for total, more in zip((mass, momentum), bodies.pin(self._u, h), strict=True):
                total += more
        contact = self.pushers.touch(k, bodies, mass, momentum)
        rubbing = bodies.rub(G if self._isotropic else self._stretched(G))
        step = Step(h, mass, momentum, rubbing, limit, *contact.springs, self.pushers.friction)
        self._u, self._sense = step.solve(self._u, self._sense)
        return self._finish(k, step, rubbing, limit, viscous, Gc)

    def _stretched(self, G: np.ndarray) -> np.ndarray:
        return np.einsum("bij,blnjd->blnid", self._stretch, G)

    def _add_viscosity(self, mass: np.ndarray, G: np.ndarray) -> np.ndarray:
        """Add the drag of the feet to the mass matrix; return it, (B, D, D) N s/m."""
        if not self._viscosity.any():
            return np.zeros_like(mass)
        share = self.bodies.stiffness / self.bodies.stiffness.sum(axis=(1, 2), keepdims=True)
        share = share * self._wet()
        drag = np.einsum("blnkd,bln,blnke->bde", G, share * self._viscosity[:, None, None], G)
        mass += self._h * drag
        return np.asarray(drag)

    def _wet(self) -> np.ndarray:
        """Return 1 for feet (B, L, N) on a film, else 0."""
        wet = np.ones(self.bodies.stiffness.shape)
        if any(scene.film for scene in self._scenes):
            places = self.bodies.places(self.bodies.feet)
            for b, scene in enumerate(self._scenes):
                if scene.film is not None:
                    wet[b] = places[b, :, :, scene.film.axis] > scene.film.border
        return wet

    def _change(self, time: float) -> None:
        for b, scene in enumerate(self._scenes):
            change = scene.change
            if change is not None and abs(change.time - time) < 0.5 * self._h:
                self.bodies.friction[b] *= change.friction
                self.bodies.add_mass(b, change.mass, change.place)

    def _influences(self, time: float) -> tuple[np.ndarray, ...]:
        """Return force (B, 2), moment (B,) about link_1's origin, load (B,) and its place."""
        bodies, b = self.bodies, len(self._scenes)
        force, moment = np.zeros((b, 2)), np.zeros(b)
        load, place = np.zeros(b), np.zeros((b, 2))
        for k, scene in enumerate(self._scenes):
            if not scene.influences:
                continue
            turn = rotation(bodies.angle[k, 0])
            state = BodyState(time, bodies.position[k], turn, self._u[k, :2], self._u[k, 2])
            for influence in scene.influences:
                f, at, extra = influence.act(state)
                force[k] += f
                moment[k] += cross(at - state.origin, f)
                load[k] += extra
                place[k] += extra * (turn.T @ (at - state.origin))
        return force, moment, load, place

    def _limits(self, k: int, load: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Return the largest friction (B, P) of everything that rubs, N."""
        bodies = self.bodies
        pressed = bodies.press(-self._gravity[:, 2], self._horizontal, load, place)
        if self._by_speed or (self._uneven and k % _REFRESH == 0):
            self._refresh()
        limit = (pressed * bodies.friction).reshape(len(load), -1) * self._limit_factor
        return bodies.rub_limits(limit)

    def _refresh(self) -> None:
        """Look up what place and speed make of the friction of every foot."""
        bodies = self.bodies
        b = len(self._scenes)
        factor = np.ones((b, bodies.feet_count))
        if self._uneven:
            where = bodies.places(bodies.feet).reshape(b, -1, 2)
            factor *= friction_factor(self._cells, self._gradient, where)
        if self._by_speed:
            G = bodies.velocities(bodies.feet).reshape(b, -1, 2, self._u.shape[1])
            speed = np.linalg.norm(np.einsum("bpkd,bd->bpk", G, self._u), axis=-1)
            slow = np.exp(-speed / self._weakening_speed[:, None])
            factor *= 1.0 - self._weakening[:, None] * (1.0 - slow)
            factor *= 1.0 + self._stiction[:, None] * np.exp(-speed / self._stiction_speed[:, None])
        self._limit_factor = factor

    def _finish(
        self,
        k: int,
        step: Step,
        rubbing: np.ndarray,
        limit: np.ndarray,
        viscous: np.ndarray,
        Gc: np.ndarray,
    ) -> tuple[np.ndarray, ...]:
        """Move everything, account for forces and energy."""
        bodies, u, h = self.bodies, self._u, self._h
        normal, shear = step.tip_force(u)
        touched = self.pushers.record(k, u, normal, shear)
        slip = np.einsum("bpkd,bd->bpk", rubbing, u)
        self._lost += h * np.einsum("bp,bpk,bpk->b", limit, self._sense, slip)
        self._lost += h * np.einsum("bd,bde,be->b", u, viscous, u)
        self._work += h * self.pushers.power(u)
        com_velocity = np.einsum("blkd,bd->blk", Gc, u)
        self._tip_over(com_velocity, limit)
        bodies.move(u, com_velocity, h)
        kinetic = bodies.kinetic_energy()
        columns = (bodies.origins(), bodies.angle, *touched, self._work, self._lost, kinetic)
        return tuple(np.array(column) for column in columns)

    def _tip_over(self, com_velocity: np.ndarray, limit: np.ndarray) -> None:
        """Keep the moments that horizontal forces have about the table, for the next step.

        sum h_k F_k - h_c m a, divided by the weight, is how far the pressure's centre moves.
        """
        bodies = self.bodies
        acceleration = (com_velocity - bodies.com_velocity) / self._h
        pull = self._gravity[:, None, :2] - acceleration
        self._horizontal = bodies.com_height[:, :, None] * bodies.mass[:, :, None] * pull
        self._horizontal += self.pushers.tipping(bodies.links)
        if bodies.links == 2:
            self._horizontal += self._joint_tipping(acceleration, limit)

    def _joint_tipping(self, acceleration: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """Return moments (B, 2, 2) of the hinge's force, which acts at half the lower height."""
        bodies = self.bodies
        own = self.pushers.forces(2)[:, 1] + self._rubbing_force(limit)[:, 1]
        own += bodies.mass[:, 1, None] * self._gravity[:, :2]
        on_second = bodies.mass[:, 1, None] * acceleration[:, 1] - own
        height = bodies.com_height.min(axis=1)[:, None]
        return np.stack([-height * on_second, height * on_second], axis=1)

    def _rubbing_force(self, limit: np.ndarray) -> np.ndarray:
        """Return the table's friction on each link (B, L, 2), N."""
        bodies = self.bodies
        count = bodies.feet_count
        feet = self._sense[:, :count] * limit[:, :count, None]
        if not self._isotropic:
            feet = np.einsum("bji,bpj->bpi", self._stretch, feet)
        return -feet.reshape(len(feet), bodies.links, -1, 2).sum(axis=2)
