from .reduction import Reduced as Reduced
from .reduction import reduce_action as reduce_action
from .run import simulate as simulate
from .time_stepping import restitution as restitution
