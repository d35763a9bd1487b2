"""Expected running times COCO publishes for CMA-ES and DE, in 20 dimensions.

From the tables `bbob/2009`, `bbob/2012` and `bbob/2019/pptables.html` of COCO's archive,
https://github.com/numbbo/ppdata-archive: running times as multiples of the best of 2009, which
stands at the head of each column. Functions and targets as in `sizes`.
"""

from typing import NamedTuple

BEST_OF_2009 = {
    1: (43, 43, 43, 43, 43, 43, 43),
    8: (2039, 3871, 4040, 4148, 4219, 4371, 4484),
}


class Published(NamedTuple):
    """What one paper measured: multiples of the best of 2009, by function."""

    method: str
    name: str
    source: str
    multiples: dict[int, tuple[float, ...]]

    def running_times(self, function: int) -> list[float]:
        """Expected evaluations to each target."""
        pairs = zip(self.multiples[function], BEST_OF_2009[function], strict=True)
        return [multiple * best for multiple, best in pairs]


PUBLISHED = (
    Published(
        "cma-es",
        "BIPOP-CMA-ES",
        "Hansen (2009), Benchmarking a BI-population CMA-ES on the BBOB-2009 function testbed",
        {
            1: (7.937984, 14.260465, 20.134884, 26.375194, 32.699225, 45.325581, 57.368992),
            8: (3.996959, 4.031172, 4.346254, 4.477965, 4.538927, 4.568047, 4.613381),
        },
    ),
    Published(
        "cma-es",
        "BIPOP-aCMA-ES",
        "Loshchilov, Schoenauer and Sebag (2012), Black-box optimization benchmarking of "
        "NIPOP-aCMA-ES and NBIPOP-aCMA-ES on the BBOB-2012 noiseless testbed",
        {
            1: (7.454264, 13.831008, 20.137984, 26.582946, 32.662016, 45.606202, 58.679070),
            8: (3.317639, 4.047757, 4.296535, 4.373674, 4.416844, 4.430077, 4.460764),
        },
    ),
    Published(
        "cma-es",
        "CMAa",
        "Brockhoff, Auger and Hansen (2012), On the impact of active covariance matrix "
        "adaptation in the CMA-ES with mirrored mutations and small initial population size on "
        "the noiseless BBOB testbed",
        {
            1: (7.807752, 14.062016, 20.150388, 25.885271, 32.333333, 45.102326, 58.071318),
            8: (3.551905, 3.544872, 3.823878, 3.906991, 3.952722, 3.969648, 4.004862),
        },
    ),
    Published(
        "de",
        "DE-scipy-2019",
        "Varelas and Dahito (2019), Benchmarking multivariate solvers of SciPy on the noiseless "
        "testbed",
        {
            1: (113.100775, 223.617054, 241.049612, 244.744186, 244.776744, 244.776744, 244.939535),
            8: (17.879451, 11.524275, 11.102492, 10.838734, 10.672924, 10.321635, 13.036337),
        },
    ),
)
