from .march import restitution as restitution
from .path import Reduced as Reduced
from .path import reduce_action as reduce_action
from .run import simulate as simulate
