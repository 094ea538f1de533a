"""Robots: any URDF, catalogue name or Pinocchio model becomes one chain with a task frame."""

from .catalogue import CatalogueEntry as CatalogueEntry
from .catalogue import catalogue as catalogue
from .catalogue import robots_folder as robots_folder
from .changes import Payload as Payload
from .friction import Friction as Friction
from .limits import effort_limits as effort_limits
from .limits import torque_limits as torque_limits
from .pose_task import PoseTask as PoseTask
from .robot import Robot as Robot
from .robot import load as load
from .task import Task as Task
from .tasks import TASKS as TASKS
from .tasks import task_named as task_named
from .workspace import WorkspaceCircle as WorkspaceCircle
from .workspace import reachable_circle as reachable_circle
