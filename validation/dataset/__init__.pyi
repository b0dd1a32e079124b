from .load import load as load
from .load import read_index as read_index
from .score import Scores as Scores
from .score import score as score
from .seal import check_truth as check_truth
