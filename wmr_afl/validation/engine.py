"""MuJoCo, spoken to in q, v and u of a model."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.validation.mechanism import Mechanism
from wmr_afl.validation.mjcf import Contact, xml_of

SINKING = 400, 50  # steps, in which wheels sink onto the floor: with and without what they moved before
EXACT = 1e-13  # [m, rad], to which q is found from the joints


def mujoco() -> ModuleType:
    """The engine.

    Raises:
        WmrError: if it is not installed.
    """
    try:
        import mujoco as engine  # type: ignore[import-untyped]
    except ImportError:
        raise WmrError("MuJoCo is not installed", "pip install 'wmr-afl[mujoco]'") from None
    return engine


class Engine:
    """A mechanism in the engine.

    Raises:
        WmrError: if the engine is not installed, or refuses the mechanism.
    """

    def __init__(self, mechanism: Mechanism, contact: Contact, loads: Floats) -> None:
        self.mechanism, self.loads, self._mujoco = mechanism, loads, mujoco()
        self.xml = xml_of(mechanism, loads, contact)
        try:
            self.model = self._mujoco.MjModel.from_xml_string(self.xml)
        except ValueError as error:
            problem = f"the engine refuses {mechanism.model.name}: {str(error).splitlines()[0]}"
            raise WmrError(problem, "give masses and inertias above zero") from None
        self.data = self._mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in ("root x", "root y", "root heading", *mechanism.joints)]
        self._places, self._rates = [one.qposadr[0] for one in joints], [one.dofadr[0] for one in joints]
        wheels = [wheel.name for wheel in mechanism.wheels]
        self._spins = [self.model.joint(f"{name} spin").dofadr[0] for name in wheels]
        self._heights = [self.model.joint(f"{name} load").qposadr[0] for name in wheels]
        self._bodies = [self.model.body(f"{name} wheel").id for name in wheels]
        self._shapes = {self.model.geom(name).id: k for k, name in enumerate(wheels)}
        self._q = np.zeros(mechanism.model.coordinate_count)
        self._sunk = self._sink(max(contact.step, 0.5 * contact.slow))

    def start(self, q: Floats, rates: Floats) -> None:
        """At q (n,) with q' (n,); wheels spin so that they roll."""
        engine, data = self._mujoco, self.data
        engine.mj_resetData(self.model, data)
        place, jacobian = (one.full() for one in self.mechanism.place(q))
        data.qpos[self._places], data.qvel[self._rates] = place.ravel(), jacobian @ rates
        data.qpos[self._heights], self._q = self._sunk, np.array(q, dtype=float)
        engine.mj_forward(self.model, data)
        velocity = np.zeros(6)
        for k, body in enumerate(self._bodies):
            along = data.xmat[body].reshape(3, 3)[:2, 0]
            engine.mj_objectVelocity(self.model, data, engine.mjtObj.mjOBJ_BODY, body, velocity, 0)
            radius = self.mechanism.wheels[k].radius + 0.5 * self._sunk[k]  # contact is in the middle of what overlaps
            data.qvel[self._spins[k]] = along @ velocity[3:5] / np.hypot(*along) / radius
        engine.mj_forward(self.model, data)

    def drive(self, u: Floats, steps: int) -> None:
        """Held voltages (n_u,) for so many steps.

        Raises:
            WmrError: if the engine warns of a motion that it cannot follow.
        """
        self.data.ctrl[:] = u
        self._mujoco.mj_step(self.model, self.data, steps)
        if any(warning.number for warning in self.data.warning) or not np.all(np.isfinite(self.data.qvel)):
            raise WmrError(f"the engine cannot follow {self.mechanism.model.name}", "choose lower voltages")

    @property
    def state(self) -> Floats:
        """x = [q; v] (2n-m,), v by its definition from q', whether or not wheels slip."""
        place = self.data.qpos[self._places]
        for _ in range(20):
            found, jacobian = (one.full() for one in self.mechanism.place(self._q))
            left = found.ravel() - place
            if np.abs(left).max() < EXACT:
                break
            self._q = self._q - np.linalg.lstsq(jacobian, left, rcond=None)[0]
        rates = np.linalg.lstsq(jacobian, self.data.qvel[self._rates], rcond=None)[0]
        return np.concatenate([self._q, self.mechanism.pseudo_velocities(self._q, rates).full().ravel()])

    @property
    def friction(self) -> Floats:
        """What each wheel's force in the plane is, over its load there, (wheels,)."""
        forces, one = np.zeros((len(self._bodies), 3)), np.zeros(6)
        for k in range(self.data.ncon):
            contact = self.data.contact[k]
            self._mujoco.mj_contactForce(self.model, self.data, k, one)
            wheel = self._shapes[contact.geom2 if contact.geom2 in self._shapes else contact.geom1]
            forces[wheel] += contact.frame.reshape(3, 3).T @ one[:3]
        with np.errstate(all="ignore"):
            needed = np.hypot(forces[:, 0], forces[:, 1]) / np.abs(forces[:, 2])
        return np.where(np.isfinite(needed), needed, np.inf)

    def _sink(self, step: float) -> Floats:
        """How high wheels stand at rest (wheels,) [m]: hardly below the floor."""
        engine, model, data = self._mujoco, self.model, self.data
        engine.mj_resetData(model, data)
        usual, model.opt.timestep = model.opt.timestep, step
        for _ in range(SINKING[0]):
            engine.mj_step(model, data)
            data.qvel[self._rates], data.qvel[self._spins], data.qpos[self._places] = 0.0, 0.0, 0.0
        for _ in range(SINKING[1]):
            data.qvel[:] = 0.0
            engine.mj_step(model, data)
        model.opt.timestep = usual
        return np.asarray(data.qpos[self._heights]).copy()
