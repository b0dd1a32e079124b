from .limit import THRESHOLDS as THRESHOLDS
from .limit import Limit as Limit
from .limit import compare as compare
from .march import Marched as Marched
from .march import simulate as simulate
