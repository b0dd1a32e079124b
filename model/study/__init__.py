"""What if: the same blow on variants of one action; the thesis's studies (Section 4.4) checked line by line."""

from model.study.blow_measures import BlowMeasures, measure_blow
from model.study.variants import Study, Variant, compare

__all__ = ["BlowMeasures", "Study", "Variant", "compare", "measure_blow"]
