"""From any description of a robot to a Pinocchio model: URDF, xacro, MJCF, names, the catalogue."""

from .catalogue import CatalogueEntry as CatalogueEntry
from .catalogue import catalogue as catalogue
from .catalogue import robots_folder as robots_folder
