"""The zoo: every robot of the catalogue with a wrong model and a controller with default gains."""

from .experiment import ZooCase as ZooCase
from .experiment import run_zoo as run_zoo
from .experiment import zoo_case as zoo_case
from .experiment import zoo_numbers as zoo_numbers
