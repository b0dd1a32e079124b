from .files import check_truth as check_truth
from .files import load as load
from .files import read_index as read_index
from .score import Scores as Scores
from .score import score as score
