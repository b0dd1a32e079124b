from .differentiate import sensitivities as sensitivities
from .events import EVENTS as EVENTS
from .motion_driven import motion_sensitivities as motion_sensitivities
from .options import SensitivityOptions as SensitivityOptions
from .parameter_names import Parameter as Parameter
from .parameter_names import effective_paths as effective_paths
from .parameter_names import find_parameters as find_parameters
from .result import Sensitivities as Sensitivities
