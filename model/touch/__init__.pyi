from . import figure as figure
from .feel import Feel as Feel
from .feel import fastest_repetition as fastest_repetition
from .feel import feel as feel
from .hammer_speed import FORCES as FORCES
from .hammer_speed import hammer_speeds as hammer_speeds
from .weights import Weights as Weights
from .weights import weigh as weigh
