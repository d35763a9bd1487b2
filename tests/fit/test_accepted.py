"""Tables on measured cells against accepted numbers of an independent program."""

import numpy as np
import pytest

from barnax.fit.settings import TableSettings
from barnax.fit.table_fit import fit_tables, pooled_errors

GIVEN = {"tau1 [s]": 10.0, "tau2 [s]": 100.0}
NO_PROOF = {"max_boxes": 0, "folds": 0}
KNOWN, FREE = {"ocv_correction": False}, {"rising_ocv": False}
RISING: dict[str, bool] = {}


@pytest.fixture(scope="module")
def measured(samsung):
    names = ("dst_25degC_80soc", "us06_25degC_80soc", "dst_25degC_50soc", "us06_25degC_50soc")
    return [samsung(name) for name in names]


def in_mv(errors):
    return [1e3 * value for each in errors for value in (each.rmse_v, each.above_v)]


# RMSE of every record, whole and above 10 % SOC.
KNOWN_MV = [16.913, 3.899, 34.111, 4.741, 25.292, 3.111, 39.066, 2.333]
FREE_MV = [8.994, 2.656, 8.598, 2.813, 9.542, 2.734, 13.536, 1.328]


@pytest.mark.parametrize(
    ("records", "ocv", "root_mv", "r0_mohm", "errors_mv"),
    [
        (1, KNOWN, 17.2737, 71.895, KNOWN_MV),
        (2, FREE, 9.3685, 71.547, FREE_MV),
        (2, RISING, 10.263, None, [10.35, 2.71, 9.60, 2.84]),
    ],
)
def test_given_time_constants_give_the_accepted_tables(
    measured, records, ocv, root_mv, r0_mohm, errors_mv
):
    settings = TableSettings(**ocv, fixed=GIVEN, **NO_PROOF)
    fit = fit_tables(measured[:records], settings)
    assert 1e3 * fit.objective_v == pytest.approx(root_mv, rel=1e-3)
    r0_ohm = fit.tables.at("R0 [Ohm]", np.array([0.5]))[0]
    assert r0_mohm is None or 1e3 * r0_ohm == pytest.approx(r0_mohm, rel=1e-3)
    actual = in_mv([pooled_errors([each], fit.tables) for each in measured])[: len(errors_mv)]
    # As many digits as are told.
    assert actual == pytest.approx(errors_mv, rel=1e-3, abs=0.006 if r0_mohm is None else None)


@pytest.mark.parametrize(
    ("records", "ocv", "root_mv", "tau_s"),
    [
        (1, FREE, 5.9566, (13.982, 53.32)),
        pytest.param(2, FREE, 9.1463, (2.0, 27.28), marks=pytest.mark.slow),
    ],
)
def test_the_search_finds_the_accepted_optimum(measured, records, ocv, root_mv, tau_s):
    settings = TableSettings(**ocv, **NO_PROOF)
    fit = fit_tables(measured[:records], settings)
    assert 1e3 * fit.objective_v <= root_mv * (1 + 1e-5)
    assert fit.tables.tau_s == pytest.approx(tau_s, rel=1e-3)
    assert [each.name for each in fit.at_bound] == (["tau1 [s]"] if records == 2 else [])


def test_held_out_blocks_have_the_accepted_errors(measured):
    fit = fit_tables(measured[:1], TableSettings(max_boxes=0, rising_ocv=False, block_s=400.0))
    assert fit.cross_validation is not None
    assert in_mv([fit.cross_validation.tables]) == pytest.approx((13.819, 1.583), rel=1e-3)


@pytest.mark.slow
def test_a_record_left_out_is_predicted_as_a_fit_to_the_others_does(measured):
    settings = TableSettings(fixed=GIVEN, max_boxes=0)
    both = fit_tables(measured[:2], settings).cross_validation
    assert both is not None
    for own, other, errors in zip(measured[:2], measured[1::-1], both.by_record, strict=True):
        scanned = pooled_errors([own], fit_tables([other], settings).tables)
        assert in_mv([errors]) == pytest.approx(in_mv([scanned]), rel=1e-6)


@pytest.mark.slow
def test_the_interval_of_another_record_holds_what_a_fourth_one_shows(measured):
    settings, holds, own_holds = TableSettings(fixed=GIVEN, max_boxes=0), [], []
    for left, record in enumerate(measured):
        others = [each for index, each in enumerate(measured) if index != left]
        shown = {(e.name, e.soc): e.value for e in fit_tables([record], settings).intervals}
        for each in fit_tables(others, settings).intervals:
            if each.record_low is not None and (each.name, each.soc) in shown:
                value = shown[each.name, each.soc]
                holds.append(each.record_low <= value <= each.record_high)
                if each.low is not None and each.high is not None:
                    own_holds.append(each.low <= value <= each.high)
    assert len(holds) > 100
    assert np.mean(holds) >= 0.9
    # What the joint fit says of itself is of these records alone.
    assert np.mean(own_holds) < 0.85
