"""What is unknown of a robot, and the models that hold it as parameters."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from .._checks import flag, instance, located, name_list, word
from ..adaptation.natural import MatrixInequality
from ..exceptions import ParameterError, UnusedGainWarning
from ..laws.law import SYMBOLS, Law
from ..models.basis import BasisDynamics, LumpedDynamics, read_matrix
from ..models.bodies import PAYLOAD, BodyDynamics
from ..models.camera_kinematics import CAMERA, CameraKinematics
from ..models.dynamics import Dynamics, StackedDynamics
from ..models.joint_effects import (
    KINDS,
    USUAL,
    JointEffects,
    chosen_kinds,
    without_joint_effects,
)
from ..models.linear_kinematics import GEOMETRY, FrameKinematics
from ..models.task_kinematics import ComKinematics, JointKinematics, TaskKinematics
from ..models.tracker_kinematics import TRACKER, TrackerKinematics
from ..models.translations import BASE, FIRST, LENGTHS, TOOL, Translation, Words
from ..robot.robot import Robot
from ..tasks.frame import ComTask, ImageTask
from ..tasks.task import JointTask
from .noise import Tuning
from .rates import FORGETTING, PREDICTING

REGRESSORS = ("exact", "nominal")
EFFECTS = tuple(kind for kind in KINDS if kind not in USUAL)
_PLACED = (BASE, TRACKER, GEOMETRY)  # before the translations
_FLAGS = (TOOL, *_PLACED, LENGTHS, "friction", "armature")
WORDS = (*_FLAGS, "bodies", PAYLOAD, *EFFECTS)
_FRICTION = ("viscous", "coulomb")


@dataclass(frozen=True, eq=False)
class Unknown:
    """The unknown parameters of a robot, which are adapted; by default the tool and all bodies.

    ``make_controller``, ``Estimator``, ``identify`` and ``excite`` also take plain words in
    its place, such as ``unknown="payload"`` or ``unknown=["tool", "friction"]``: what they do not
    name is known then. The words are "tool", "base", "tracker", "geometry", "lengths", "bodies",
    "payload", "friction", "armature", "gear_friction", "asymmetry" and "offset".

    The kinematic estimates stand in the order of the chain: base, ``translations``, ``lengths``,
    tool.

    Attributes:
        tool: whether the translation of the task frame, or of each, is unknown. None: it is where
            the task is one of frames and ``lengths`` does not contain it; see also ``identify`` and
            ``excite``.
        base: whether the position of the base is unknown, in the frame in which x is measured.
        tracker: whether x is measured in axes of its own, turned and displaced from those of the
            base by an unknown placement, see ``models.TrackerKinematics``.
        geometry: whether every placement is a little off: shifts and small turns of the base, of
            all joints and the tool, see ``models.FrameKinematics``.
        translations: joints whose whole placement is unknown, by name, or ``Translation`` objects.
            The words "tool", "base", "lengths" and "joint:length" may stand among them, which
            fixes their place among the estimates.
        lengths: links whose length along its direction is unknown, by the names of their joints;
            True for all links, the tool included.
        bodies: unknown inertial parameters: "all", "payload" (the bodies of the task frames),
            "none", or the names of the joints that carry the bodies. With lengths
            that are lumped with inertias, the products with all bodies are unknown.
        friction: whether the friction of the joints is unknown: True, False, or "viscous" or
            "coulomb" alone. None: it is with the law "separation", and known with published laws.
        armature: whether the rotor inertias are unknown; None: as for friction.
        effects: further unknown coefficients of the joints, see ``Friction``: "offset",
            "asymmetry", "gear_friction", or of one joint or shaft, as "elbow.offset" and
            "elbow.armature".
        basis: (10 n, p) matrix B of the user's own dynamic parameters, pi = B a, instead of bodies;
            or the path of a file with it.
        lmi: (p, k, k) coefficient matrices of the inequality that natural adaptation keeps, for a
            basis; or the path of a file with them.
        regressor: with unknown lengths, "exact" (lumped parameters) or, for comparison, "nominal"
            (the regressor of the nominal lengths).

    Raises:
        InputError: a value of the wrong kind, or an inequality without a basis.
    """

    tool: bool | None = None
    base: bool = False
    tracker: bool = False
    geometry: bool = False
    translations: Words = ()
    lengths: bool | str | Sequence[str] = False
    bodies: str | Sequence[str] = "all"
    friction: bool | str | None = None
    armature: bool | None = None
    effects: str | Sequence[str] = ()
    basis: Any = None
    lmi: Any = None
    regressor: str = "exact"

    def __post_init__(self) -> None:
        """Refuse values of the wrong kind."""
        for name in _PLACED:
            flag(getattr(self, name), f"unknown.{name}")
        for name in ("tool", "armature"):
            instance(getattr(self, name), bool | None, f"unknown.{name}")
        given = self.translations
        if isinstance(given, str | bytes | Mapping) or not isinstance(given, Iterable):
            given = name_list(given, "unknown.translations", ParameterError)
        object.__setattr__(self, "translations", tuple(given))
        if not isinstance(self.lengths, bool):
            name_list(self.lengths, "unknown.lengths")
        if not isinstance(self.friction, bool | None):
            word(self.friction, _FRICTION, "unknown.friction")
        chosen_kinds(self.effects)
        name_list(self.bodies, "unknown.bodies")
        for name, read in (("basis", read_matrix), ("lmi", MatrixInequality.from_file)):
            value = getattr(self, name)
            if isinstance(value, str | Path):
                with located(f"unknown.{name}"):
                    object.__setattr__(self, name, read(Path(value)))
        word(self.regressor, REGRESSORS, "unknown.regressor")
        if self.lmi is not None and self.basis is None:
            raise ParameterError(
                "an inequality belongs to a basis of your own.",
                where="unknown.lmi",
                hint="Give a basis too.",
            )

    @classmethod
    def of(cls, given: UnknownLike) -> Unknown:
        """Return what is unknown, given as such, by words, or by None for the default.

        Raises:
            InputError: a word that is none of those above.
        """
        if given is None:
            return cls()
        if isinstance(given, cls):
            return given
        words = [word(name, WORDS, "unknown") for name in name_list(given, "unknown")]
        bodies = "all" if "bodies" in words else PAYLOAD if PAYLOAD in words else "none"
        chosen: dict[str, Any] = {name: name in words for name in _FLAGS}
        return cls(bodies=bodies, effects=[name for name in words if name in EFFECTS], **chosen)

    def with_names(
        self,
        kinematic: Words | None = None,
        dynamic: str | Sequence[str] | None = None,
        joint: str | Sequence[str] | None = None,
    ) -> Unknown:
        """Return the same with these translations, bodies and joint coefficients; None: as it is.

        Raises:
            InputError: there are no such coefficients.
        """
        changes: dict[str, Any] = {} if dynamic is None else {"bodies": dynamic}
        if kinematic is not None:
            changes |= {"tool": False, "translations": kinematic}
        if joint is not None:
            own = chosen_kinds(joint)
            friction = [kind for kind in _FRICTION if kind in own]
            changes["friction"] = friction[0] if len(friction) == 1 else bool(friction)
            changes["armature"] = "armature" in own
            changes["effects"] = [kind for kind in own if kind not in USUAL]
        return replace(self, **changes)

    def with_joints(self) -> Unknown:
        """Return the same with friction and rotor inertias unknown, unless stated otherwise."""
        return replace(
            self,
            friction=True if self.friction is None else self.friction,
            armature=True if self.armature is None else self.armature,
        )

    def translation_words(self, *, tool: bool) -> list[str | Translation]:
        """Return the unknown translations in the order of their estimates.

        ``tool`` says whether the tool is unknown where ``self.tool`` is None.
        """
        given = self.translations
        flags = [name for name in _PLACED if getattr(self, name) and name not in given]
        words: list[str | Translation] = [*flags, *given]
        if self.lengths is True:
            words.append(LENGTHS)
        elif self.lengths is not False:
            words += [f"{name}:length" for name in name_list(self.lengths, "unknown.lengths")]
        named = {each for each in words if isinstance(each, str)}
        wanted = tool and f"{TOOL}:length" not in named if self.tool is None else self.tool
        if wanted and not named & {TOOL, LENGTHS}:
            words.append(TOOL)
        return words


UnknownLike: TypeAlias = Unknown | str | Sequence[str] | None
"""What ``Unknown.of`` takes."""


def nominal_kinematics(robot: Robot, unknown: Unknown, law: type[Law]) -> TaskKinematics:
    """Return the kinematics of the model, without the constraints of the robot.

    By default the tool is unknown, of a joint task and of a robot that stands nothing.

    Raises:
        InputError: unknown translations that cannot be used, or not by this law.
    """
    if isinstance(robot.task, JointTask | ComTask):
        known = JointKinematics if isinstance(robot.task, JointTask) else ComKinematics
        return known(robot, unknown.translation_words(tool=False))
    words = unknown.translation_words(tool=not robot.constraints)
    if robot.task.frames:
        return FrameKinematics(robot, words)
    kinematics: TaskKinematics
    geometry, tracked = (name in words for name in (GEOMETRY, TRACKER))
    others = [word for word in words if word not in _PLACED]
    filmed = isinstance(robot.task, ImageTask)
    apart = filmed or robot.constraints
    if (apart and (tracked or geometry)) or (geometry and (tracked or set(others) - {TOOL})):
        raise ParameterError(
            f"'{GEOMETRY}' contains base, joints and tool, and stands alone; '{TRACKER}' is of "
            "measured positions, as both are of robots without constraints; with the task 'image' "
            "the camera is unknown in their place.",
            where="unknown.translations",
            hint="`pinadapt calibrate` finds the geometry and a tracker from a log.",
        )
    if filmed:
        others = [word for word in others if word != CAMERA]
        place = CAMERA
        kinematics = CameraKinematics(robot, others)
    elif geometry:
        place = GEOMETRY
        kinematics = FrameKinematics(robot, GEOMETRY)
    elif tracked:  # it contains the position of the base
        place = TRACKER
        kinematics = TrackerKinematics(robot, others)
    else:
        kinematics = FrameKinematics(robot, words)
        place = BASE if any(part.joint == FIRST for part in kinematics.translations) else ""
    if place and not law.uses_position_error:
        raise ParameterError(
            f"the law '{law.name}' learns from velocities, which do not show where '{place}' is.",
            where="unknown.translations",
            hint='Take the law "separation", which learns from positions too.',
        )
    return kinematics


def nominal_dynamics(
    robot: Robot,
    unknown: Unknown,
    joint: str | Sequence[str],
    lengths: Sequence[Translation] = (),
) -> Dynamics:
    """Return the inertial parameters, stacked with those of the joints where there are some.

    Args:
        robot: the model.
        unknown: what is adapted.
        joint: joint coefficients that are unknown by default: "all", "none" or some of their kinds.
        lengths: unknown translations to be lumped with the inertias, see ``lumped_lengths``.

    Raises:
        InputError: words or a basis that cannot be used.
    """
    usual = chosen_kinds(joint)
    said = {**dict.fromkeys(USUAL, unknown.friction), "armature": unknown.armature}
    kinds = [k for k in USUAL if said[k] in (True, k) or (said[k] is None and k in usual)]
    kinds += chosen_kinds(unknown.effects)
    stacked = kinds or robot.friction.present
    carrier = without_joint_effects(robot) if stacked else robot
    inertial: Dynamics = BodyDynamics(carrier, unknown.bodies)  # checks the words in any case
    if unknown.basis is not None:
        inertial = BasisDynamics(carrier, unknown.basis)
    elif lengths:
        inertial = LumpedDynamics(carrier, lengths)
    return StackedDynamics(inertial, JointEffects(robot, kinds)) if stacked else inertial


def lumped_lengths(
    kinematics: TaskKinematics, unknown: Unknown, kind: str, law: type[Law]
) -> list[Translation]:
    """Return the translations to be lumped with the inertias, whose regressor contains them.

    None with the nominal regressor, and none with a basis of the user's own, which takes care of
    lengths itself.

    Args:
        kinematics: of the model.
        unknown: what is adapted.
        kind: of adaptation, "custom" for an object.
        law: of the controller.

    Raises:
        InputError: an adaptation that does not apply to lumped parameters.
    """
    lengths = [part for part in kinematics.translations if part.joint not in (None, FIRST)]
    names = [part.name for part in lengths]
    if not lengths or kind == "none" or unknown.basis is not None or law.approximate_regressor:
        return []
    if unknown.regressor == "nominal":
        warnings.warn(
            f"the placements of {names} are unknown, but the nominal regressor contains their "
            "nominal values: the proof does not cover this closed loop. "
            'regressor = "exact" does.',
            stacklevel=5,
        )
        return []
    if kind == "natural":
        raise ParameterError(
            f"natural adaptation does not apply while the placements of {names} are unknown: "
            "lengths multiply inertias, and the lumped parameters that remain are no longer the "
            "inertias of bodies, so they have no cone to stay in.",
            where="adaptation",
            hint='Use "gradient", "composite" or "least-squares" with the law "separation", '
            '"adaptive-jacobian" or "adaptive-inverse-dynamics-improved", which never invert '
            'M_hat, or "projected", which keeps it positive definite, with any law.',
        )
    return lengths


def warn_of_unused_gains(tuning: Tuning, kind: str, kind_k: str, names: Sequence[str]) -> None:
    """Name the given gains that neither the law nor the adaptation uses, and those that they do.

    Args:
        tuning: of the loop, with all gains as users write them; None is not given.
        kind: of adaptation of the dynamic estimate; "custom" for an object.
        kind_k: of that of the kinematic estimate.
        names: of gains that a law may be given; none for a law with its own.
    """
    law = tuning.law
    motion = tuning.motion
    dynamics = motion.dynamics
    inertial = dynamics.inertial.size
    used = [n for n in names if hasattr(law, SYMBOLS.get(n, n))]
    if kind not in ("none", "custom"):
        used += ["gamma_d"] * (inertial > 0) + ["gamma_joint"] * (dynamics.size > inertial)
    if kind in PREDICTING and dynamics.size:
        used += ["prediction_rate", "prediction_filter", *["forgetting"] * (kind in FORGETTING)]
    if motion.kinematics.size and kind_k not in ("none", "custom") and law.learns_kinematics:
        used.append("gamma_k")
    idle = [name for name, gain in tuning.rates.items() if gain is not None and name not in used]
    if idle:
        warnings.warn(
            f"nothing uses {', '.join(idle)}: the law '{law.name}', its adaptation ('{kind}') and "
            f"what is unknown here use {', '.join(used) or 'none of these'}.",
            UnusedGainWarning,
            stacklevel=5,
        )
