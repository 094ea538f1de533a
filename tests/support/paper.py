"""The arm of Wang and Xie (2009), section 5: basis, inequality, gains, motion, estimates."""

from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.description.catalogue import robots_folder
from tests.support.chains import catalogue_robot

BASIS = np.loadtxt(robots_folder() / "planar_2r" / "basis.csv", delimiter=",")  # of a1, a2, a3
LMI = pa.adaptation.MatrixInequality.from_file(robots_folder() / "planar_2r" / "lmi.csv")
CIRCLE = pa.trajectories.Circle([0.8, 0.0], 0.3, 2.0).as_given()
WRONG = {"a_k": [1.4, 1.5], "a_d": [4.0, 0.5, 0.5]}


def paper_controller(law: str, adaptation: str, **options: Any) -> pa.Controller:
    """Return a controller in the paper's parameters and feedback gains; others as given."""
    return pa.make_controller(
        catalogue_robot("planar_2r"),
        law=law,
        adaptation=adaptation,
        unknown=pa.Unknown(lengths=True, basis=BASIS, lmi=LMI),
        **{"Kv": 40.0, "Kp": 400.0, "alpha": 5.0, **options},
    )
