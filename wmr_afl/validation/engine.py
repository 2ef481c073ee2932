"""MuJoCo, spoken to in q, v and u of a model."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from ctypes.util import find_library
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.validation.mechanism import Mechanism
from wmr_afl.validation.mjcf import Contact, xml_of

SINKING = 400, 50  # steps, in which wheels sink onto the floor: with and without what they moved before
SLIPS = 0.95  # of the friction that there is
EXACT = 1e-13  # [m, rad], to which q is found from the joints


def mujoco() -> ModuleType:
    """The engine.

    Raises:
        WmrError: if it is not installed.
    """
    if "mujoco" not in sys.modules and not os.environ.get("DISPLAY") and find_library("EGL"):
        os.environ.setdefault("MUJOCO_GL", "egl")  # it decides on import how pictures are drawn
    try:
        import mujoco as engine  # type: ignore[import-untyped]
    except ImportError:
        raise WmrError("MuJoCo is not installed", "pip install 'wmr-afl[mujoco]'") from None
    if engine.get_mju_user_warning() is None:  # else it writes a file where one stands; warnings are counted
        engine.set_mju_user_warning(lambda text: None)
    return engine


@dataclass(frozen=True)
class Grip:
    """What wheels had of the floor, (wheels,) each."""

    friction: Floats  # the most that was needed, as a share of the load at that time
    least: Floats  # load [N]
    most: Floats  # load [N]
    lifted: Floats  # [s], when a wheel first had none, infinite if never

    @classmethod
    def none(cls, count: int) -> Grip:
        """Of no time at all."""
        never = np.full(count, np.inf)
        return cls(np.zeros(count), never, np.zeros(count), never)

    def beside(self, other: Grip) -> Grip:
        """Of both times."""
        least, most = np.minimum(self.least, other.least), np.maximum(self.most, other.most)
        lifted = np.minimum(self.lifted, other.lifted)
        return Grip(np.maximum(self.friction, other.friction), least, most, lifted)

    def check(self, mechanism: Mechanism, there_is: float, what: str) -> None:
        """Fails if wheels had no load, or needed more friction than `there_is`: then agreement would mean nothing.

        Raises:
            WmrError: with the wheel, and the time or the friction.
        """
        if np.any(np.isfinite(self.lifted)):
            first = int(self.lifted.argmin())
            problem = f"{what} lifts wheel {mechanism.wheels[first].name} off the floor at {self.lifted[first]:.3g} s"
            raise WmrError(problem, "a planar model does not hold there; lower the masses or drive slower")
        if self.friction.max() > SLIPS * there_is:
            worst = int(self.friction.argmax())
            share = f"{self.friction[worst]:.2g} of the load in friction at wheel {mechanism.wheels[worst].name}"
            remedy = "agreement would mean nothing; start elsewhere, or look at the masses at this wheel"
            raise WmrError(f"{what} needs {share}: it slips", remedy)


class Engine:
    """A mechanism in the engine, in the plane, or in space with all masses at `height` [m].

    Raises:
        WmrError: if the engine is not installed, or refuses the mechanism, or it does not stand on its wheels.
    """

    def __init__(self, mechanism: Mechanism, contact: Contact, loads: Floats, height: float | None = None) -> None:
        self.mechanism, self._mujoco, self._q = mechanism, mujoco(), np.zeros(mechanism.model.coordinate_count)
        if height is not None and not mechanism.stands(self._q):
            problem = f"{mechanism.model.name} does not stand: its centre of mass is not well within its wheels"
            raise WmrError(problem, "leave space out: in the plane nothing tips")
        self.xml = xml_of(mechanism, loads, contact, height)
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
        self._bodies = [self.model.body(f"{name} wheel").id for name in wheels]
        self._shapes = {self.model.geom(name).id: k for k, name in enumerate(wheels)}
        zero, jacobian = (one.full() for one in mechanism.place(self._q))
        self._zero, self._inverse = zero.ravel(), np.linalg.pinv(jacobian) if mechanism.is_linear else None
        self._standing = self._sink(max(contact.step, 0.5 * contact.slow))

    def start(self, q: Floats, rates: Floats) -> None:
        """At q (n,) with q' (n,); wheels spin so that they roll."""
        engine, data = self._mujoco, self.data
        engine.mj_resetData(self.model, data)
        place, jacobian = (one.full() for one in self.mechanism.place(q))
        data.qpos[:], self._q = self._standing, np.array(q, dtype=float)
        data.qpos[self._places], data.qvel[self._rates] = place.ravel(), jacobian @ rates
        engine.mj_forward(self.model, data)
        velocity = np.zeros(6)
        for k, body in enumerate(self._bodies):
            along = data.xmat[body].reshape(3, 3)[:2, 0]
            engine.mj_objectVelocity(self.model, data, engine.mjtObj.mjOBJ_BODY, body, velocity, 0)
            radius = 0.5 * (self.mechanism.wheels[k].radius + data.xpos[body][2])  # contact is amid what overlaps
            data.qvel[self._spins[k]] = along @ velocity[3:5] / np.hypot(*along) / radius
        engine.mj_forward(self.model, data)

    def drive(self, u: Floats, steps: int) -> None:
        """Held voltages (n_u,) for so many steps.

        Raises:
            WmrError: if the engine warns of a motion that it cannot follow.
        """
        self.data.ctrl[:] = u
        self._mujoco.mj_step(self.model, self.data, steps)
        if np.any(self.data.warning.number) or not np.all(np.isfinite(self.data.qvel)):
            raise WmrError(f"the engine cannot follow {self.mechanism.model.name}", "choose lower voltages")

    @property
    def state(self) -> Floats:
        """x = [q; v] (2n-m,), v by its definition from q', whether or not wheels slip."""
        place, inverse = self.data.qpos[self._places], self._inverse
        if inverse is None:
            for _ in range(20):
                found, jacobian = (one.full() for one in self.mechanism.place(self._q))
                inverse, left = np.linalg.pinv(jacobian), found.ravel() - place
                if np.abs(left).max() < EXACT:
                    break
                self._q = self._q - inverse @ left
        else:
            self._q = inverse @ (place - self._zero)
        rates = inverse @ self.data.qvel[self._rates]
        return np.concatenate([self._q, self.mechanism.pseudo_velocities(self._q, rates).full().ravel()])

    @property
    def grip(self) -> Grip:
        """What wheels have of the floor now."""
        forces, one = np.zeros((len(self._bodies), 3)), np.zeros(6)
        for k in range(self.data.ncon):
            contact = self.data.contact[k]
            self._mujoco.mj_contactForce(self.model, self.data, k, one)
            wheel = self._shapes[contact.geom2 if contact.geom2 in self._shapes else contact.geom1]
            forces[wheel] += contact.frame.reshape(3, 3).T @ one[:3]
        across, loads = np.hypot(forces[:, 0], forces[:, 1]), np.abs(forces[:, 2])
        with np.errstate(all="ignore"):
            friction = np.where(across > 0.0, across / loads, 0.0)
        return Grip(friction, loads, loads, np.where(loads > 0.0, np.inf, self.data.time))

    def _sink(self, step: float) -> Floats:
        """Positions of all joints at rest at q = 0: wheels are hardly below the floor."""
        engine, model, data = self._mujoco, self.model, self.data
        engine.mj_resetData(model, data)
        usual, model.opt.timestep = model.opt.timestep, step
        for _ in range(SINKING[0]):
            engine.mj_step(model, data)
            data.qvel[self._rates], data.qvel[self._spins], data.qpos[self._places] = 0.0, 0.0, self._zero
        for _ in range(SINKING[1]):
            data.qvel[:] = 0.0
            engine.mj_step(model, data)
        model.opt.timestep = usual
        return np.asarray(data.qpos).copy()


Watch = Callable[[Engine, float], None]  # looks at the engine at a time [s]
