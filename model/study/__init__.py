"""What if: the same blow on variants of one action; the thesis's studies (Section 4.4) checked line by line."""

from .blow_measures import BlowMeasures, measure_blow
from .variants import Study, Variant, compare

__all__ = ["BlowMeasures", "Study", "Variant", "compare", "measure_blow"]
