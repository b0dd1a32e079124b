from . import figure as figure
from .feel import Feel as Feel
from .feel import Weights as Weights
from .feel import fastest_repetition as fastest_repetition
from .feel import feel as feel
from .feel import weigh as weigh
from .hammer_speed import FORCES as FORCES
from .hammer_speed import hammer_speeds as hammer_speeds
