from .differentiate import sensitivities as sensitivities
from .events import EVENTS as EVENTS
from .options import SensitivityOptions as SensitivityOptions
from .parameter_names import Parameter as Parameter
from .parameter_names import find_parameters as find_parameters
from .result import Sensitivities as Sensitivities
