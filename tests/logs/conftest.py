"""The robot of the logs."""

import pytest

from tests.support.chains import catalogue_robot


@pytest.fixture
def robot():
    """Return a robot with six joints."""
    return catalogue_robot("ur5")
