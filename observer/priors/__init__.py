"""Prior estimators of seed 000: static and adaptive, beside the low-pass, bootstrap and Gaussian-sum filters.

One interface (`Estimator`): settings in a frozen dataclass, `estimate(measurements)` from (n, runs, d) to (n, runs, d),
time first, all runs at once.
"""

from observer.priors.bootstrap import Bootstrap
from observer.priors.densities import AsymmetricPrior, GaussianPrior, HistogramPrior, MixturePrior, histogram_prior
from observer.priors.estimators import AdaptivePriorEstimator, Estimator, LowPass, StaticPriorEstimator
from observer.priors.gaussian_sum import GaussianSum
from observer.priors.weighting import WEIGHTINGS, Weighting

__all__ = [
    "WEIGHTINGS",
    "AdaptivePriorEstimator",
    "AsymmetricPrior",
    "Bootstrap",
    "Estimator",
    "GaussianPrior",
    "GaussianSum",
    "HistogramPrior",
    "LowPass",
    "MixturePrior",
    "StaticPriorEstimator",
    "Weighting",
    "histogram_prior",
]
