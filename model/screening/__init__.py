"""Which parameters of an action decide about a blow: locally, by Morris's screening, by Sobol' indices.

An action, a blow and named parameters with their uncertainties in; ranked tables out. `local` reads derivatives
(`model.sensitivity`), `morris` and `sobol` vary all parameters together over their uncertainties (`distributions`);
`members` computes such variants on all cores or a cluster, resumable, and `blow_marks` measures each.
Why: docs/explanation/sensitivities.md.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
