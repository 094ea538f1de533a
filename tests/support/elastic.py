"""What a robot with elastic joints stores."""

import pinocchio as pin


def energy_of(plant):
    """Return the kinetic and potential energy of links, motors and springs [J]."""
    model = plant._model
    data = plant._data
    links = plant._links
    total = pin.computeKineticEnergy(model, data, links, plant._v)
    total += pin.computePotentialEnergy(model, data, links)
    return total + 0.5 * (plant._d @ (plant._K * plant._d) + plant._w @ (plant._B * plant._w))
