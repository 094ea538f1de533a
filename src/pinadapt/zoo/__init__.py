"""The zoo: every robot of the catalogue with a wrong model and a controller with default gains."""

from .case import ZooCase as ZooCase
from .case import zoo_case as zoo_case
from .experiment import ZooRow as ZooRow
from .experiment import run_zoo as run_zoo
from .experiment import zoo_names as zoo_names
from .experiment import zoo_row as zoo_row
