"""The keys of a scenario file: types, bounds and defaults; reading and checking of the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .._checks import LARGEST, SMALLEST, shown
from .._output import read_toml, toml
from ..description.description import is_robot_name
from ..exceptions import InputError, ScenarioError, did_you_mean
from ..laws import DEFAULT

_DESCRIPTIONS = (".urdf", ".xacro", ".xml", ".mjcf")  # files that describe robots

Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Positive = Annotated[float, Field(ge=SMALLEST, le=LARGEST, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Count = Annotated[int, Field(lt=2**63)]
Vector3 = Annotated[list[Number], Field(min_length=3, max_length=3)]
Gain = Number | list[Number] | list[list[Number]]
# Of all joints, of each, or of those named:
JointNumber = Number | list[Number] | dict[str, Number]
JointPositive = Positive | list[Positive] | dict[str, Positive]
JointNotNegative = NotNegative | list[NotNegative] | dict[str, NotNegative]


class Section(BaseModel):
    """A table of a scenario; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, populate_by_name=True)


class RobotSection(Section):
    """[robot]: which chain, which frame, which task.

    ``pixel`` is for the task "image": about the length [m] that a pixel covers at the arm.
    """

    source: str
    frame: str | None = None
    task: Literal["xy", "xz", "yz", "xyz", "pose", "image", "joint"] | None = None
    pixel: Positive | None = None
    locked: list[str] = []
    q0: list[Number] | None = None
    gravity: Vector3 | None = None
    weld_root: bool = False
    xacro: dict[str, bool | Number | str] = {}
    mass: Positive | None = None
    joint_effects: bool = False


class PayloadSection(Section):
    """[truth] payload: a load on the last body; none if the mass and the inertia are zero."""

    mass: NotNegative
    com: Vector3 = [0.0, 0.0, 0.0]
    inertia: Annotated[list[Number], Field(min_length=6, max_length=6)] = [0.0] * 6


class ShaftSection(Section):
    """A motor that turns with two joints, as of a coupled wrist; see ``pinadapt.robot.Shaft``."""

    joints: Annotated[list[str], Field(min_length=2, max_length=2)]
    sign: Literal[1, -1] = 1
    armature: NotNegative = 0.0
    viscous: NotNegative = 0.0
    coulomb: NotNegative = 0.0
    threshold: Positive = 0.01


class FrictionSection(Section):
    """[truth] or [belief] friction: effects of the joints beside rotor inertia.

    Numbers are one for all joints, a list, or a table: joint name -> number. The equation and the
    units are those of ``pinadapt.Friction``. What is not given is as described.
    """

    viscous: JointNotNegative | None = None
    coulomb: JointNotNegative | None = None
    threshold: JointPositive | None = None
    load: JointNotNegative | None = None
    asymmetry: JointNumber | None = None
    offset: JointNumber | None = None
    breakaway: JointNotNegative | None = None
    fading: JointPositive | None = None
    shafts: list[ShaftSection] = []


class TrackerSection(Section):
    """[truth] tracker: the base in the axes in which x is measured; rotation vector [rad], [m]."""

    rotation: Vector3 = [0.0, 0.0, 0.0]
    translation: Vector3 = [0.0, 0.0, 0.0]


class PinholeSection(Section):
    """[[truth.camera]]: a camera that films the tool, for the task "image".

    Position and target [m] are in the axes of the base, the target by default the described frame
    at home; focal length and size are in pixels, the roll about the line of sight in rad.
    """

    position: Vector3
    target: Vector3 | None = None
    focal: Positive = 1000.0
    size: Annotated[list[Positive], Field(min_length=2, max_length=2)] = [1280.0, 960.0]
    roll: Number = 0.0


class TruthKeys(Section):
    """Keys of [truth] and of its changes."""

    tool_translation: Vector3 | None = None
    payload: PayloadSection | None = None
    inertial_scale: Positive | dict[str, Positive] = 1.0
    link_translation: dict[str, Vector3] = {}
    friction: FrictionSection = FrictionSection()
    armature: NotNegative | list[NotNegative] | None = None
    tracker: TrackerSection | None = None
    camera: Annotated[list[PinholeSection], Field(max_length=2)] = []


class TruthChange(TruthKeys):
    """[[truth.change]]: keys of [truth] that change at the time ``at`` [s]; the others stay."""

    at: Positive


class TruthSection(TruthKeys):
    """[truth]: differences between the true robot and its description."""

    change: list[TruthChange] = []


class BeliefChange(Section):
    """[[belief.change]]: an announcement to the controller at some time."""

    at: Positive
    payload: PayloadSection | None = None
    tool_translation: Vector3 | None = None


class BeliefSection(Section):
    """[belief]: the initial estimates; ``payload`` is added after scaling."""

    inertial_scale: Positive | dict[str, Positive] = 1.0
    friction: FrictionSection = FrictionSection()
    armature: NotNegative | list[NotNegative] | None = None
    payload: PayloadSection | None = None
    kinematic: list[Number] | None = None
    dynamic: list[Number] | None = None
    learned: str | None = None
    change: list[BeliefChange] = []


class UnknownSection(Section):
    """[unknown]: what the controller adapts."""

    kinematic: str | list[str] | None = None
    dynamic: str | list[str] = "all"
    joint: str | list[str] | None = None
    basis: str | None = None
    lmi: str | None = None
    kinematic_box: bool | Number | list[Number] | list[list[Number]] | None = None
    regressor: Literal["exact", "nominal"] = "exact"


class PostureSection(Section):
    """Posture of redundant joints: the pose they return to, and how fast [rad/s]."""

    rest: list[Number] | None = None
    frequency: Positive | None = None


class GuardsSection(Section):
    """Plausibility checks of sensors, and whether estimates are held while the arm is at rest."""

    position: bool = True
    velocity: bool = True
    time: bool = True
    rest: bool = True
    limits: bool = True
    differences: bool = True
    gravity: bool = True


class ElasticitySection(Section):
    """[simulation] elasticity: the springs of ``actuators``, in a table of their own."""

    stiffness: Positive | list[Positive]
    damping: NotNegative | list[NotNegative] = 0.0
    encoders: Literal["motor", "link"] = "motor"


class ActuatorsSection(Section):
    """Late motors and elastic joints: of the true robot in [simulation], declared in [controller].

    Delay [s], bandwidth [rad/s], stiffness [N m/rad] and damping [N m s/rad] are numbers or one per
    joint.
    """

    delay: NotNegative | list[NotNegative] = 0.0
    bandwidth: Positive | list[Positive] | None = None
    stiffness: Positive | list[Positive] | None = None
    damping: NotNegative | list[NotNegative] = 0.0
    encoders: Literal["motor", "link"] = "motor"


class ControllerSection(Section):
    """[controller]: law, adaptation, gains."""

    law: str = DEFAULT
    adaptation: (
        Literal[
            "natural",
            "gradient",
            "projected",
            "natural-composite",
            "natural-memory",
            "composite",
            "composite-memory",
            "least-squares",
            "none",
        ]
        | None
    ) = None
    kinematic_adaptation: Literal["gradient", "least-squares", "none"] | None = None
    modifications: str | list[str] | dict[str, bool | Number | list[Number]] | None = None
    Kv: Gain | None = None
    Kp: Gain | None = None
    alpha: Number | None = None
    beta: Number | None = None
    lag: NotNegative | None = None
    lambda_s: Positive | None = None
    width: Gain | None = None
    weight: Number | None = None
    bound: Gain | None = None
    gravity: Gain | None = None
    gamma_d: Gain | None = None
    gamma_joint: Number | None = None
    gamma_k: Gain | None = None
    prediction_rate: Number | None = None
    prediction_filter: Number | None = None
    forgetting: NotNegative | None = None
    kinematic_rate: Positive | None = None
    kinematic_forgetting: NotNegative | None = None
    R_k: Gain | None = None
    Q: Number | None = None
    lambda_: Number | None = Field(default=None, alias="lambda")
    lambda_a: Number | None = None
    acceleration: Literal["filtered", "ideal"] = "filtered"
    damping: NotNegative = 0.2
    watch: bool = True
    posture: Positive | list[Number] | PostureSection | None = None
    guards: bool | GuardsSection = True
    actuators: ActuatorsSection | None = None


class OrientationSection(Section):
    """[reference] orientation of a pose: a quaternion xyzw, about which the tool may swing.

    Without a quaternion it is the initial orientation.
    """

    quaternion: Annotated[list[Number], Field(min_length=4, max_length=4)] | None = None
    axis: Vector3 = [0.0, 0.0, 1.0]
    amplitude: NotNegative = 0.0
    period: Positive = 3.0
    phase: Number = 0.0


class ReferenceSection(Section):
    """[reference]: keys of every kind.

    ``start`` is "rest": the motion begins where the robot is, at rest, after an approach if its
    first point is elsewhere; ``ramp`` [s] is the duration of the smooth start. Or it is "moving":
    the motion is taken exactly as it is, with its own speed and place at time 0.
    """

    start: Literal["rest", "moving"] = "rest"
    ramp: Positive | None = None
    orientation: OrientationSection | None = None
    governor: bool = False


class CircleSection(ReferenceSection):
    """[reference] kind = "circle"."""

    kind: Literal["circle"] = "circle"
    center: list[Number] | None = None
    radius: Positive = 0.1
    period: Positive = 3.0
    plane: Literal["xy", "yz", "xz"] | None = None
    phase: Number = 0.0


class LissajousSection(ReferenceSection):
    """[reference] kind = "lissajous"."""

    kind: Literal["lissajous"]
    center: list[Number] | None = None
    amplitude: list[Number]
    cycles: list[Number]
    period: Positive = 6.0
    phase: Number | list[Number] = 0.0


class SinusoidSection(ReferenceSection):
    """[reference] kind = "sinusoid": center + amplitude sin(2 pi t / period + phase) per joint.

    A number applies to all coordinates. With the default phase the motion starts at rest.
    """

    kind: Literal["sinusoid"]
    center: list[Number] | None = None
    amplitude: Number | list[Number]
    period: Positive | list[Positive] = 3.0
    phase: Number | list[Number] = -pi / 2


class FourierSection(ReferenceSection):
    """[reference] kind = "fourier": Fourier series, as `pinadapt excite` writes them.

    Each row has the coefficients of one coordinate, the slowest harmonic first.
    """

    kind: Literal["fourier"]
    center: list[Number] | None = None
    cosine: list[list[Number]]
    sine: list[list[Number]]
    period: Positive = 10.0


class WaypointsSection(ReferenceSection):
    """[reference] kind = "waypoints": minimum-jerk motions from point to point.

    The points are offsets from the start unless ``relative`` is false.
    """

    kind: Literal["waypoints"]
    points: list[list[Number]]
    segment: Positive = 2.0
    relative: bool = True


class HoldSection(ReferenceSection):
    """[reference] kind = "hold": a point, by default the initial position."""

    kind: Literal["hold"]
    center: list[Number] | None = None


Reference = Annotated[
    CircleSection
    | LissajousSection
    | SinusoidSection
    | FourierSection
    | WaypointsSection
    | HoldSection,
    Field(discriminator="kind"),
]


REFERENCES: dict[str, type[Section]] = {
    "circle": CircleSection,
    "lissajous": LissajousSection,
    "sinusoid": SinusoidSection,
    "fourier": FourierSection,
    "waypoints": WaypointsSection,
    "hold": HoldSection,
}


class NoiseSection(Section):
    """[simulation] noise: standard deviations."""

    q: NotNegative = 0.0
    v: NotNegative = 0.0
    x: NotNegative = 0.0
    angle: NotNegative = 0.0
    tau: NotNegative | list[NotNegative] = 0.0


class CameraSection(Section):
    """[simulation] camera: frames per second, their delay [s], and the fraction of lost frames."""

    rate: Positive | None = None
    delay: NotNegative = 0.0
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.0


class MjcfSection(Section):
    """[simulation] engine: a MuJoCo model of the true robot and its names for joints and frames."""

    mjcf: str
    joints: dict[str, str] = {}
    frame: str | None = None
    base: str | None = None


class SimulationSection(Section):
    """[simulation]: duration, sampling, engine, sensors and actuators."""

    duration: Positive = 10.0
    dt: Positive = 1e-3
    mode: Literal["sampled", "continuous"] = "sampled"
    substeps: Annotated[Count, Field(ge=1)] | None = None
    engine: Literal["pinocchio", "mujoco"] | MjcfSection = "pinocchio"
    elasticity: ElasticitySection | None = None
    actuators: ActuatorsSection | None = None
    noise: NoiseSection = NoiseSection()
    delay: NotNegative = 0.0
    camera: CameraSection | None = None
    carry: bool = True
    encoder: NotNegative | list[NotNegative] = 0.0
    torque_offset: NotNegative | list[NotNegative] | None = None
    torque_limits: bool | None = None
    compensated: Literal["nominal", "loaded"] | None = None
    seed: Annotated[Count, Field(ge=0)] = 0


class MotorSection(Section):
    """[[motors.joint]]: a moteus motor of a joint; see ``realtime.moteus_arm.Motor``."""

    joint: str
    id: Annotated[Count, Field(ge=1, le=126)]
    sign: Literal[1, -1] = 1
    ratio: Positive = 1.0
    offset: Number = 0.0
    torque: Positive = 1.0


class MotorsSection(Section):
    """[motors]: moteus motors on a CAN bus, for `pinadapt drive moteus`."""

    interface: str = "socketcan"
    channel: str = "can0"
    timeout: Positive = 0.01
    joint: list[MotorSection]


class ScenarioTables(Section):
    """A whole scenario file."""

    title: Annotated[str, Field(max_length=1000)] = ""
    robot: RobotSection
    truth: TruthSection = TruthSection()
    belief: BeliefSection = BeliefSection()
    unknown: UnknownSection = UnknownSection()
    controller: ControllerSection = ControllerSection()
    reference: Reference = CircleSection()
    simulation: SimulationSection = SimulationSection()
    motors: MotorsSection | None = None


def allowed_keys(location: tuple[Any, ...], raw: dict[str, Any]) -> list[str]:
    """Return the keys allowed in the table that holds ``location``, a path of keys."""
    table: type[Section] = ScenarioTables
    for key in location:
        if isinstance(key, int):  # of a list of tables
            continue
        if key == "reference":
            table = REFERENCES.get(raw.get("reference", {}).get("kind", "circle"), CircleSection)
            continue
        field = table.model_fields.get(str(key))
        parts = _types(field.annotation) if field else []
        sections = [part for part in parts if isinstance(part, type) and issubclass(part, Section)]
        if not sections:
            break
        table = sections[0]
    return [field.alias or name for name, field in table.model_fields.items()]


def _types(annotation: Any) -> list[Any]:
    """Return the members of a union, or the type itself."""
    return list(getattr(annotation, "__args__", ())) or [annotation]


@contextmanager
def prefix_errors(key: str) -> Iterator[None]:
    """Prefix the place of errors raised inside with a section or dotted key.

    Raises:
        InputError: the error raised inside, with its own type.
    """
    try:
        yield
    except InputError as error:
        place = error.where or ""
        head = place.partition(".")[0]
        if head in ScenarioTables.model_fields:
            raise
        inside = allowed_keys((*key.split("."), ""), {})
        if head not in inside and head in allowed_keys(("simulation", ""), {}):
            key, inside = (
                "simulation",
                [head],
            )  # sensors and limits of the controller are keys of [simulation]
        joint = "." if head in inside else ": "
        raise type(error)(
            error.what, where=f"{key}{joint}{place}" if place else key, hint=error.hint
        ) from error


def read_tables(path: Path, settings: Sequence[str] = ()) -> ScenarioTables:
    """Return the checked tables of a scenario file after applying ``key=value`` settings.

    Raises:
        ScenarioError: the file is missing or not TOML, or a key or value is not allowed.
    """
    _refuse_robots(path)
    return tables_with(read_toml(path), dict(map(parsed, settings)), str(path))


def tables_with(raw: dict[str, Any], values: Mapping[str, Any], where: str) -> ScenarioTables:
    """Return checked tables after writing values by dotted keys into raw ones.

    Raises:
        ScenarioError: a key or value is not allowed.
    """
    kind = _kind_of(raw)
    for key, value in values.items():
        put(raw, key, value)
    if _kind_of(raw) != kind:
        _drop_keys_of(kind, raw, list(values))
    return check_tables(raw, where)


def _refuse_robots(path: Path) -> None:
    """Refuse the file or the name of a robot in place of a scenario.

    Raises:
        ScenarioError: it is one; the message says how to get a scenario.
    """
    named = not path.exists() and is_robot_name(str(path))
    if not named and path.suffix.lower() not in _DESCRIPTIONS:
        return
    raise ScenarioError(
        "this is a robot, not a scenario.",
        where=str(path),
        hint=f"Write a scenario for it first: `pinadapt init {path}`.",
    )


def _kind_of(raw: Mapping[str, Any]) -> Any:
    """Return the kind of reference that raw tables have, even a wrong one."""
    reference = raw.get("reference", {})
    return reference.get("kind", "circle") if isinstance(reference, dict) else None


def _drop_keys_of(kind: Any, raw: dict[str, Any], given: Sequence[str]) -> None:
    """Drop the file's keys that only the former kind of reference has; those given stay."""
    old, new = (REFERENCES.get(name) for name in (kind, _kind_of(raw)))
    if old is None or new is None:
        return
    for key in set(old.model_fields) - set(new.model_fields):
        if f"reference.{key}" not in given:
            raw["reference"].pop(key, None)


def check_tables(raw: Mapping[str, Any], where: str) -> ScenarioTables:
    """Return checked tables from raw ones.

    Raises:
        ScenarioError: a key or value is not allowed; the message says which are and suggests the
            nearest.
    """
    raw = dict(raw)
    if isinstance(raw.get("reference"), dict):
        raw["reference"] = {"kind": "circle", **raw["reference"]}
    try:
        return ScenarioTables.model_validate(raw)
    except ValidationError as error:
        raise ScenarioError(_explain(error, raw), where=where) from error


def parsed(setting: str) -> tuple[str, Any]:
    """Return key and value of one ``key=value``."""
    key, equals, text = setting.partition("=")
    if not equals:
        raise ScenarioError(
            f"expected key=value with a dotted key, got '{setting}'.", where="--set"
        )
    return key.strip(), toml_value(text.strip())


def put(raw: dict[str, Any], key: str, value: Any) -> None:
    """Write one value into raw tables, by its dotted key; tables of a list are numbered, from 0.

    Raises:
        ScenarioError: the key has an empty part, or a part of it is not a table.
    """
    parts = key.split(".")
    if not all(parts):
        raise ScenarioError(f"expected a dotted key, got '{key}'.", where="--set")
    table, way = raw, parts[:-1]
    while way:
        inside, number = table.setdefault(way[0], {}), "".join(way[1:2])
        if isinstance(inside, list) and number.isdigit() and int(number) < len(inside):
            inside, way = inside[int(number)], way[1:]
        if not isinstance(inside, dict):
            raise ScenarioError(f"'{way[0]}' in '{key}' is not a table.", where="--set")
        table, way = inside, way[1:]
    table[parts[-1]] = value


def toml_value(text: str) -> Any:
    """Return the value of a TOML expression; text that is not TOML is taken as a string."""
    try:
        return toml.loads(f"value = {text}")["value"]
    except toml.TOMLDecodeError:
        return text
    except (ValueError, RecursionError) as error:
        raise ScenarioError("the value is too long or nested too deeply.", where="--set") from error


def _explain(error: ValidationError, raw: dict[str, Any]) -> str:
    """Return one sentence for each key with a problem."""
    sentences: dict[str, list[str]] = {}
    for problem in error.errors(include_url=False):
        location = tuple(part for part in problem["loc"] if part not in REFERENCES)
        location += ("kind",) if problem["type"] == "union_tag_invalid" else ()
        key = _dotted(location)
        sentences.setdefault(key, []).append(_sentence(problem, location, raw))
    return "; ".join(
        f"{key}: {' or '.join(dict.fromkeys(parts))}" for key, parts in sentences.items()
    )


def _dotted(location: tuple[Any, ...]) -> str:
    """Return a dotted key, without the names that pydantic adds for unions of types."""
    names = [
        str(part)
        for part in location
        if not (isinstance(part, str) and ("[" in part or part in _TYPES))
        and not str(part).endswith("Section")
    ]
    return ".".join(names) or "scenario"


_TYPES = {"float", "constrained-float", "int", "str", "dict", "bool", "list"}


def _message(problem: Any) -> str:
    """Return what is wrong with a value; limits of floating-point range are named as such."""
    bounds = problem.get("ctx", {})
    if LARGEST in (bounds.get("le"), -bounds.get("ge", 0.0)):
        return f"is too large to compute with, over {LARGEST:g}"
    if bounds.get("ge") == SMALLEST:
        positive = problem["input"] > 0.0
        tiny = f"is too small to compute with, under {SMALLEST:g}"
        return tiny if positive else "input should be greater than 0"
    return str(problem["msg"][0].lower() + problem["msg"][1:])


def _sentence(problem: Any, location: tuple[Any, ...], raw: dict[str, Any]) -> str:
    if problem["type"] == "extra_forbidden":
        allowed = allowed_keys(location[:-1], raw)
        guess = did_you_mean(str(location[-1]), allowed)
        return f"unknown key; allowed here: {', '.join(allowed)}.{guess}"
    if problem["type"] == "missing":
        return f"this key is required; in the file, or by --set {_dotted(location)}=VALUE"
    if problem["type"] == "model_type":
        return f"expected a table, got {shown(problem['input'])}"
    message = _message(problem)
    expected = problem.get("ctx", {}).get("expected") or problem.get("ctx", {}).get("expected_tags")
    options = (
        [word.strip(" '") for word in str(expected).replace(" or ", ",").split(",")]
        if expected
        else []
    )
    given = problem.get("ctx", {}).get("tag", problem["input"])
    guess = did_you_mean(given, options) if isinstance(given, str) else ""
    return f"{message}, got {shown(given)}.{guess}"
