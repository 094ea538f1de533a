"""The public API: few names and arguments, and former ones with what has replaced them."""

import pytest

import pinadapt as pa

FORMER = {  # function -> its former keywords, and a part of what has replaced each
    pa.make_controller: {
        "believed": "first argument, 'robot'",
        "kinematic": "pa.Unknown(tool=True)",
        "dynamic": 'pa.Unknown(bodies="all")',
        "joint": "pa.Unknown(friction=True, armature=True)",
        "basis": "pa.Unknown(basis=",
        "lmi": "pa.Unknown(basis=..., lmi=",
        "regressor": "pa.Unknown(regressor=",
        "kinematic_box": "pa.Limits(box=",
        "torque_limits": "pa.Limits(torque=",
        "damping": "pa.Limits(damping=",
        "watch": "pa.Limits(stop_on_divergence=",
        "guards": "pa.Limits(guards=",
        "noise": "pa.Sensors(noise=",
        "encoder": "pa.Sensors(encoder=",
        "camera": "pa.Sensors(camera=pa.Camera(",
        "carry": "pa.Sensors(compensate_delay=",
    },
    pa.simulate: {
        "dt": "pa.Engine(dt=",
        "mode": "pa.Engine(continuous=True)",
        "substeps": "pa.Engine(substeps=",
        "acceleration": "pa.Engine(ideal_acceleration=True)",
        "torque_limits": "pa.Engine(torque_limits=",
        "a_k": 'start={"a_k": ...}',
        "a_d": 'start={"a_d": ...}',
        "noise": "pa.Sensors(noise=",
        "delay": "pa.Camera(delay=",
        "camera": "pa.Sensors(camera=pa.Camera(",
        "encoder": "pa.Sensors(encoder=",
        "changes": "pa.Events(changes=",
        "beliefs": "pa.Events(announcements=",
        "view": 'progress="live"',
    },
    pa.identify: {
        "kinematic": "pa.Unknown(tool=True)",
        "dynamic": "pa.Unknown(bodies=",
        "joint": "pa.Unknown(friction=True, armature=True)",
    },
    pa.excite: {
        "kinematic": "pa.Unknown(tool=True)",
        "dynamic": "pa.Unknown(bodies=",
        "joint": "pa.Unknown(friction=True, armature=True)",
    },
}
FORMER |= {  # class -> the same
    pa.Controller: {"belief": "nominal=pa.controller.NominalRobot("},
    pa.Limits: {
        "watch": "stop_on_divergence=",
        "singular": "pa.controller.ControllerLimits",
        "estimate": "pa.controller.ControllerLimits",
    },
    pa.controller.ControllerLimits: {"watch": "stop_on_divergence="},
    pa.controller.Senses: {"carrier": "compensator=pa.models.DelayCompensator("},
    pa.Events: {"beliefs": "announcements="},
    pa.Sensors: {"delay": "pa.Camera(delay=", "seed": "pa.plants.SimulatedSensors("},
    pa.plants.SimulatedSensors: {"camera": "pa.Sensors(camera=", "noise": "pa.Sensors(noise="},
    pa.plants.ElasticPlant: {"elasticity": "pa.robot.Actuators(stiffness="},
    pa.laws.BoundedTorque: {"pace": "bandwidth_share="},
    pa.models.DelayCompensator: {"carry": "enabled=", "blind": "longest_gap="},
    pa.models.StackedDynamics: {"joint": "joints="},
}
FORMER[pa.make_estimator] = FORMER[pa.make_controller]

# Names that version 0.1 had in the package itself, and where they are.
DOWN = {
    "adaptation": "Adaptation BodyInequality BoxProjection Composite CompositeMemory DeadZone "
    "Drive Drives ErrorLeak Estimate ExponentiatedGradient Frozen Gradient GravityProjection Leak "
    "LeastSquares MassMatrixProjection MatrixInequality Natural Normalised Stacked Wrapper",
    "controller": "NominalRobot Guards Senses SensorQuality",
    "excitation": "ExcitingMotion LimitUse",
    "filters": "FilteredRegressor FilteredTorque Filters LowPass MotionFilters NoFilters "
    "PositionObserver",
    "information": "Excitation Information PayloadEstimate",
    "laws": "LAWS AdaptiveInverseDynamics AdaptiveInverseDynamicsImproved "
    "AdaptiveInverseDynamicsVelocity AdaptiveJacobian ApproximateJacobian "
    "ApproximateJacobianGravity BoundedTorque Command ComputedTorque Craig Feedback KinematicLoop "
    "Law MiddletonGoodwin Posture ResolvedAcceleration Saturation Separation Signals SlotineLi "
    "SpongOrtega Truth",
    "models": "BaseParameters BasisDynamics BodyDynamics Dynamics FrameKinematics JointEffects "
    "JointKinematics LumpedDynamics Momentum MomentumRegressor StackedDynamics TaskKinematics "
    "Translation TypicalMotion base_parameters",
    "plants": "ElasticPlant MujocoPlant PinocchioPlant Plant",
    "robot": "Gravity Succession",
    "simulation": "run_continuous",
    "tasks": "JointTask PoseTask PositionTask Task",
    "trajectories": "Circle FixedOrientation FourierSeries Hold Lissajous PoseCircle "
    "PoseTrajectory Sinusoid Swing Trajectory Waypoints",
}
PLACES = {name: f"{room}.{name}" for room, names in DOWN.items() for name in names.split()}


# --- arguments ---


@pytest.mark.parametrize(
    ("function", "wrong", "right"),
    [
        (pa.simulate, "durations", "duration"),
        (pa.identify, "adaption", "adaptation"),
        (pa.excite, "excursions", "excursion"),
        (pa.load, "frames", "frame"),
        (pa.make_controller, "unknwn", "unknown"),
        (pa.make_controller, "kv", "Kv"),
        (pa.make_estimator, "sensor", "sensors"),
        (pa.Limits, "torqe", "torque"),
        (pa.Unknown, "tol", "tool"),
        (pa.Engine, "substep", "substeps"),
        (pa.Camera, "rat", "rate"),
        (pa.Controller, "low", "law"),
    ],
)
def test_a_wrong_keyword_is_refused_with_the_nearest(function, wrong, right):
    with pytest.raises(pa.InputError, match=f"no argument '{wrong}'.*Did you mean '{right}'"):
        function(**{wrong: None})


# --- names ---


def test_a_name_of_a_sub_package_is_named_in_the_error_of_the_package():
    for name, place in PLACES.items():
        room, _, inside = place.partition(".")
        assert hasattr(getattr(pa, room), inside)
        with pytest.raises(AttributeError, match=f"is now pinadapt.{place}$"):
            getattr(pa, name)
