"""The identified circuit and its extended Kalman filter as one C99 header, for a microcontroller.

The same filter as `barnax.filters` with "joint" offset and capacity: no allocation, one structure,
single or double precision by one definition.
"""

from collections.abc import Iterator

import numpy as np

from ..cell.circuits import TURN_WIDTH, get_circuit
from ..execution import in_float64
from ..filters.model import CAPACITY, GRID, OFFSET, STEPS_PER_SOC, WALK_S, FilterModel, model_of
from ..results import Result
from .exporter import Export, Exporter, note_lines, numbers
from .tables import table_caveats, tables_of

HYSTERESIS = {"none": 0, "instant": 1, "dynamic": 2}
REMEMBERS = 3

TEMPLATE = """\
/*
{notes}
 *
 * Include it in one source file, with BARNAX_REAL defined as float where double is too slow.
 *
 *     barnax_filter filter;
 *     barnax_filter_start(&filter, 0.5, 0.1, 0);
 *     for every sample: barnax_filter_step(&filter, interval_s, held_a, current_a, voltage_v);
 *
 * The start is of a cell that has rested: its state of charge, the standard deviation of that, and
 * which way the current last flowed: 1 charging, -1 discharging, or 0 where that is not known. A
 * hysteresis then starts halfway between its branches; one that turns with the charge passed, with
 * a standard deviation that reaches both of them.
 *
 * held_a flowed since the sample before, interval_s ago (0 at the first sample); current_a and
 * voltage_v are of this sample. filter.x[0] is the state of charge, sqrt(filter.p[0][0]) its
 * standard deviation. A sum that is not finite in filter.x says that the filter is lost: start it
 * anew.
 */
#ifndef BARNAX_FILTER_H
#define BARNAX_FILTER_H

#include <tgmath.h>

#ifndef BARNAX_REAL
#define BARNAX_REAL double
#endif
typedef BARNAX_REAL barnax_real;

#define BARNAX_PAIRS {pairs}
#define BARNAX_ERRORS {errors}
/* 0 none, 1 turns at once, 2 turns with the charge passed, 3 so from where the current turned */
#define BARNAX_HYSTERESIS {kind}
/* SOC, pairs, dynamic hysteresis, parts of the model's error, current offset, log of capacity */
#define BARNAX_FIRST_ERROR (1 + BARNAX_PAIRS + (BARNAX_HYSTERESIS == 2))
#define BARNAX_OFFSET (BARNAX_FIRST_ERROR + BARNAX_ERRORS)
#define BARNAX_CAPACITY (BARNAX_OFFSET + 1)
#define BARNAX_STATES (BARNAX_CAPACITY + 1)

{declarations}

typedef struct {{
    barnax_real x[BARNAX_STATES];
    barnax_real p[BARNAX_STATES][BARNAX_STATES];
    barnax_real direction;
    /* Between the branches: now, and where the current turned; and the SOC drawn since. */
    barnax_real turned, turned_from, drawn;
    int has_begun;
    barnax_real innovation_v;
    barnax_real innovation_sd_v;
}} barnax_filter;

/* OCV, half hysteresis, scale of errors, R0, R1 and so on at a SOC, and their slopes. */
static void barnax_look_up(barnax_real soc, barnax_real *value, barnax_real *slope)
{{
    const barnax_real along = (soc - barnax_first_soc) * BARNAX_STEPS;
    int row = 0, k;
    if (along > 0)
        row = along < BARNAX_POINTS - 2 ? (int)along : BARNAX_POINTS - 2;
    for (k = 0; k < BARNAX_COLUMNS; k++) {{
        const int place = barnax_place[k];
        value[k] = barnax_constant[k];
        slope[k] = 0;
        if (place >= 0) {{
            const barnax_real below = barnax_table[row][place];
            const barnax_real rise = barnax_table[row + 1][place] - below;
            value[k] = below + (along - row) * rise;
            slope[k] = rise * BARNAX_STEPS;
        }}
    }}
}}

/* A cell that has rested at a SOC, known to a standard deviation, after 1, -1 or an unknown 0. */
static void barnax_filter_start(barnax_filter *f, barnax_real soc, barnax_real soc_sd,
                                int direction)
{{
    barnax_real value[BARNAX_COLUMNS], slope[BARNAX_COLUMNS];
    int i, j;
    barnax_look_up(soc, value, slope);
    for (i = 0; i < BARNAX_STATES; i++) {{
        f->x[i] = 0;
        for (j = 0; j < BARNAX_STATES; j++)
            f->p[i][j] = 0;
    }}
    f->x[0] = soc;
    f->p[0][0] = soc_sd * soc_sd;
    for (i = 0; i < BARNAX_PAIRS; i++) {{
        const barnax_real rest_v = value[4 + i] * barnax_rest_current_a;
        f->p[1 + i][1 + i] = rest_v * rest_v;
    }}
    f->direction = f->turned = f->turned_from = direction;
    f->drawn = 0;
    f->has_begun = 0;
    if (BARNAX_HYSTERESIS == 2) {{
        f->x[1 + BARNAX_PAIRS] = direction;
        f->p[1 + BARNAX_PAIRS][1 + BARNAX_PAIRS] = direction == 0;
    }}
    for (i = 0; i < BARNAX_ERRORS; i++)
        f->p[BARNAX_FIRST_ERROR + i][BARNAX_FIRST_ERROR + i] =
            barnax_error_sd_v[i] * barnax_error_sd_v[i];
    f->p[BARNAX_OFFSET][BARNAX_OFFSET] = barnax_offset_sd_a * barnax_offset_sd_a;
    f->p[BARNAX_CAPACITY][BARNAX_CAPACITY] = barnax_capacity_sd * barnax_capacity_sd;
    f->innovation_v = f->innovation_sd_v = 0;
}}

/* One interval later; the slope is a diagonal and the columns of SOC, offset and capacity. */
static void barnax_move(barnax_filter *f, barnax_real interval_s, barnax_real held_a)
{{
    static const int column[3] = {{0, BARNAX_OFFSET, BARNAX_CAPACITY}};
    barnax_real value[BARNAX_COLUMNS], slope[BARNAX_COLUMNS];
    barnax_real own[BARNAX_STATES], by[3][BARNAX_STATES] = {{{{0}}}}, walk[BARNAX_STATES] = {{0}};
    barnax_real moved[BARNAX_STATES][BARNAX_STATES];
    barnax_real *x = f->x;
    const barnax_real capacity_as = 3600 * barnax_capacity_ah * exp(x[BARNAX_CAPACITY]);
    const barnax_real flow_a = held_a - x[BARNAX_OFFSET];
    const barnax_real counted = barnax_current_sd_a * interval_s / (3600 * barnax_capacity_ah);
    int i, j, k;

    barnax_look_up(x[0], value, slope);
    for (i = 0; i < BARNAX_STATES; i++)
        own[i] = 1;
    by[1][0] = interval_s / capacity_as;
    by[2][0] = interval_s * flow_a / capacity_as;
    walk[0] = counted * counted;
    x[0] -= by[2][0];
    for (i = 0; i < BARNAX_PAIRS; i++) {{
        const barnax_real gain = -expm1(-interval_s / barnax_tau_s[i]);
        x[1 + i] += gain * (value[4 + i] * flow_a - x[1 + i]);
        own[1 + i] = 1 - gain;
        by[0][1 + i] = gain * slope[4 + i] * flow_a;
        by[1][1 + i] = -gain * value[4 + i];
    }}
    if (BARNAX_HYSTERESIS == 2 && fabs(held_a) >= barnax_rest_current_a && held_a != 0) {{
        const int h = 1 + BARNAX_PAIRS;
        const barnax_real passed = barnax_gamma * fabs(held_a) * interval_s / capacity_as;
        const barnax_real gain = -expm1(-passed), away = x[h] + (held_a > 0 ? 1 : -1);
        x[h] -= gain * away;
        own[h] = 1 - gain;
        by[2][h] = (1 - gain) * passed * away;
    }}
    for (i = 0; i < BARNAX_ERRORS; i++) {{
        const int e = BARNAX_FIRST_ERROR + i;
        const barnax_real gain = -expm1(-interval_s / barnax_error_s[i]);
        x[e] *= 1 - gain;
        own[e] = 1 - gain;
        walk[e] = gain * (2 - gain) * barnax_error_sd_v[i] * barnax_error_sd_v[i];
    }}
    walk[BARNAX_OFFSET] =
        barnax_offset_sd_a * barnax_offset_sd_a * interval_s / barnax_walk_s;
    walk[BARNAX_CAPACITY] =
        barnax_capacity_sd * barnax_capacity_sd * interval_s / barnax_walk_s;

    for (i = 0; i < BARNAX_STATES; i++)
        for (j = 0; j < BARNAX_STATES; j++) {{
            moved[i][j] = own[i] * f->p[i][j];
            for (k = 0; k < 3; k++)
                moved[i][j] += by[k][i] * f->p[column[k]][j];
        }}
    for (i = 0; i < BARNAX_STATES; i++)
        for (j = i; j < BARNAX_STATES; j++) {{
            barnax_real sum = moved[i][j] * own[j];
            for (k = 0; k < 3; k++)
                sum += moved[i][column[k]] * by[k][j];
            f->p[i][j] = f->p[j][i] = sum;
        }}
    for (i = 0; i < BARNAX_STATES; i++)
        f->p[i][i] += walk[i];
}}

/* One sample: the state moves over the interval before it, and is corrected by the voltage. */
static void barnax_filter_step(barnax_filter *f, barnax_real interval_s, barnax_real held_a,
                               barnax_real current_a, barnax_real voltage_v)
{{
    barnax_real value[BARNAX_COLUMNS], slope[BARNAX_COLUMNS];
    barnax_real h[BARNAX_STATES] = {{0}}, with_state[BARNAX_STATES];
    barnax_real *x = f->x, turned = 0, errors = 0, predicted_v, variance, gain;
    barnax_real direction = f->direction;
    int i, j;

    barnax_move(f, interval_s, held_a);
    f->drawn += held_a * interval_s / (3600 * barnax_capacity_ah);
    f->turned = direction
        + (f->turned_from - direction) * (1 - tanh(fabs(f->drawn) / barnax_turn_soc));
    if (fabs(current_a) >= barnax_rest_current_a && current_a != 0)
        direction = current_a > 0 ? -1 : 1;
    if (direction != f->direction) {{
        f->turned_from = f->turned = f->has_begun ? f->turned : direction;
        f->drawn = 0;
    }}
    f->direction = direction;
    f->has_begun = 1;
    if (BARNAX_HYSTERESIS == 1)
        turned = direction;
    if (BARNAX_HYSTERESIS == 3)
        turned = f->turned;
    if (BARNAX_HYSTERESIS == 2)
        turned = x[1 + BARNAX_PAIRS];

    barnax_look_up(x[0], value, slope);
    for (i = 0; i < BARNAX_ERRORS; i++) {{
        errors += x[BARNAX_FIRST_ERROR + i];
        h[BARNAX_FIRST_ERROR + i] = value[2];
    }}
    current_a -= x[BARNAX_OFFSET];
    predicted_v = value[0] + turned * value[1] + value[2] * errors - value[3] * current_a;
    h[0] = slope[0] + turned * slope[1] + slope[2] * errors - slope[3] * current_a;
    for (i = 0; i < BARNAX_PAIRS; i++) {{
        predicted_v -= x[1 + i];
        h[1 + i] = -1;
    }}
    if (BARNAX_HYSTERESIS == 2)
        h[1 + BARNAX_PAIRS] = value[1];
    h[BARNAX_OFFSET] = value[3];

    variance = value[2] * barnax_white_sd_v * value[2] * barnax_white_sd_v;
    for (i = 0; i < BARNAX_STATES; i++) {{
        with_state[i] = 0;
        for (j = 0; j < BARNAX_STATES; j++)
            with_state[i] += f->p[i][j] * h[j];
        variance += h[i] * with_state[i];
    }}
    f->innovation_v = voltage_v - predicted_v;
    f->innovation_sd_v = sqrt(variance);
    for (i = 0; i < BARNAX_STATES; i++) {{
        gain = with_state[i] / variance;
        x[i] += gain * f->innovation_v;
        for (j = 0; j < BARNAX_STATES; j++)
            f->p[i][j] -= gain * with_state[j];
    }}
}}

#endif /* BARNAX_FILTER_H */
"""


@in_float64
def write_c_filter(result: Result) -> Export:
    """The header's source. Raises `InputError` for a result without an assessment."""
    over, caveats = result.tables and result.tables.found.tables, ()
    if result.tables is not None and over is not None:
        degc = result.tables.found.reference_degc or 0.0
        result = result.at_temperature(degc)
        others = ", ".join(f"{each:.3g}" for each in over.temperatures_degc if each != degc)
        caveats = (
            f"The filter has one temperature: all of it is for {degc:.3g} degC, and nothing "
            f"identified at {others} degC is in it.",
        )
    tables, model = tables_of(result, may_remember=True), model_of(result, (OFFSET, CAPACITY))
    caveats = (*caveats, *table_caveats(tables))
    content = TEMPLATE.format(
        notes=note_lines(tables.heading, caveats, " * "),
        pairs=model.pairs,
        errors=len(model.error_s),
        kind=REMEMBERS if get_circuit(result.model).turning else HYSTERESIS[model.hysteresis],
        declarations="\n".join(_declarations(model, tables.rest_current_a)),
    )
    return Export(content.encode(), caveats)


def _declarations(model: FilterModel, rest_current_a: float) -> Iterator[str]:
    offset_sd_a, capacity_sd = np.asarray(model.slow_sd).tolist()
    scalars = (
        ("capacity_ah", float(model.capacity_ah), "A.h"),
        ("rest_current_a", rest_current_a, "A, turns no hysteresis below"),
        ("gamma", float(model.gamma), "per unit of SOC"),
        ("turn_soc", TURN_WIDTH, "SOC, of the tangent along which a hysteresis turns"),
        ("white_sd_v", float(model.white_sd_v), "V"),
        ("current_sd_a", float(model.current_sd_a), "A"),
        ("offset_sd_a", offset_sd_a, "A"),
        ("capacity_sd", capacity_sd, "relative"),
        ("walk_s", WALK_S, "s, in which a parameter is forgotten"),
        ("first_soc", float(GRID[0]), "of the table"),
    )
    for name, value, unit in scalars:
        yield f"static const barnax_real barnax_{name} = {value!r}; /* {unit} */"
    arrays = (
        ("tau_s[BARNAX_PAIRS]", model.tau_s, "s"),
        # One more than there are: C has no empty arrays.
        ("error_s[BARNAX_ERRORS + 1]", [*np.asarray(model.error_s), 1.0], "s"),
        ("error_sd_v[BARNAX_ERRORS + 1]", [*np.asarray(model.error_sd_v), 0.0], "V"),
    )
    for name, values, unit in arrays:
        listed = ", ".join(repr(each) for each in np.asarray(values).tolist())
        yield f"static const barnax_real barnax_{name} = {{{listed}}}; /* {unit} */"
    yield ""
    yield from _table(np.asarray(model.table))


def _table(table: np.ndarray) -> Iterator[str]:
    """Columns that change with SOC as a table, all others as constants."""
    varies = np.ptp(table, axis=0) > 0
    place = np.where(varies, np.cumsum(varies) - 1, -1)
    yield f"#define BARNAX_STEPS {STEPS_PER_SOC}"
    yield f"#define BARNAX_POINTS {len(table)}"
    yield f"#define BARNAX_COLUMNS {table.shape[1]}"
    yield f"static const int barnax_place[BARNAX_COLUMNS] = {{{', '.join(map(str, place))}}};"
    yield "static const barnax_real barnax_constant[BARNAX_COLUMNS] = {"
    yield f"{numbers(np.where(varies, 0.0, table[0]))}\n}};"
    yield f"static const barnax_real barnax_table[BARNAX_POINTS][{np.count_nonzero(varies)}] = {{"
    for row in table[:, varies].tolist():
        yield f"    {{{', '.join(map(repr, row))}}},"
    yield "};"


C_FILTER = Exporter(
    name="c-filter",
    description="C99 header: the circuit with its extended Kalman filter",
    file_name="barnax_filter.h",
    write=write_c_filter,
)
