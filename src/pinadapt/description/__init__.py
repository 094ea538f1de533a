"""From a robot description (URDF, xacro, MJCF or a name) to a Pinocchio model, and back to URDF."""

from .catalogue import CatalogueEntry as CatalogueEntry
from .catalogue import catalogue as catalogue
from .catalogue import robots_folder as robots_folder
