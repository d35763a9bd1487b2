"""A record written as the makes of testers write theirs: own small files in their dialects.

Each writer takes a table under Battery Data Format labels, charge positive, and gives a file.
"""

import numpy as np
import polars as pl

from helpers.records import CURRENT, TIME, VOLTAGE, workbook

# Steps are runs of one kind: charge, discharge or rest.
WORDS = {1: ("CC Chg", "C", "CHA"), -1: ("CC DChg", "D", "DCH"), 0: ("Rest", "R", "PAU")}


def channels(table):
    """Time, current, voltage, step number, time in the step, kind, and Ah counted in the step."""
    time, current, voltage = (table[name].to_numpy() for name in (TIME, CURRENT, VOLTAGE))
    kind = np.sign(current).astype(int)
    step = 1 + np.cumsum(np.diff(kind, prepend=kind[:1]) != 0)
    # A step begins where the one before it ended.
    first = np.searchsorted(step, step)
    step_time = time - time[np.maximum(first - 1, 0)]
    flowed = np.concatenate([[0], np.cumsum(current[1:] * np.diff(time))]) / 3600
    counted = flowed - flowed[np.maximum(first - 1, 0)]
    return time, current, voltage, step, step_time, kind, counted


def clock(seconds, form="{h:02d}:{m:02d}:{s}"):
    whole, part = divmod(float(seconds), 60)
    # Clocks have no exponents.
    part = np.format_float_positional(part, trim="0")
    hours, minutes = divmod(int(whole), 60)
    return form.format(d=hours // 24, h=hours, r=hours % 24, m=minutes, s=part)


def lines(rows, delimiter=",", end=""):
    text = (delimiter.join(str(cell) for cell in row) + end for row in rows)
    return "\n".join(text) + "\n"


def neware_csv(table):
    time, current, voltage, step, step_time, kind, counted = channels(table)
    header = "DataPoint,Cycle Index,Step Index,Step Type,Time,Total Time,Current(A),Voltage(V)"
    rows = [
        (
            k + 1,
            1,
            step[k],
            WORDS[kind[k]][0],
            clock(step_time[k]),
            clock(time[k]),
            current[k],
            voltage[k],
            abs(counted[k]),
        )
        for k in range(len(time))
    ]
    return (f"{header},Capacity(Ah)\n" + lines(rows)).encode()


def neware_step_clock(table):
    """An older export: milliamperes, and no clock but the step's."""
    time, current, voltage, step, step_time, kind, counted = channels(table)
    header = "Record ID,Step ID,Step Name,Time(h:min:s.ms),Voltage(V),Current(mA),Capacity(mAh)"
    rows = [
        (
            k + 1,
            step[k],
            WORDS[kind[k]][0],
            clock(step_time[k]),
            voltage[k],
            1000.0 * current[k],
            1000.0 * abs(counted[k]),
            "2024-02-29 09:20:29",
        )
        for k in range(len(time))
    ]
    return (f"{header},Realtime\n" + lines(rows)).encode()


def neware_nda_csv(table):
    """As NewareNDA and pandas write it: an index without a name, and the clock of the steps."""
    time, current, voltage, step, step_time, kind, counted = channels(table)
    header = ",Index,Cycle,Step,Status,Time,Voltage,Current(mA),Charge_Capacity(mAh),"
    stamp = np.datetime64("2024-02-29T09:20:29") + np.round(1e6 * time).astype("timedelta64[us]")
    rows = [
        (
            k,
            k + 1,
            1,
            step[k],
            WORDS[kind[k]][0].replace(" ", "_"),
            step_time[k],
            voltage[k],
            1000.0 * current[k],
            1000.0 * max(counted[k], 0.0),
            1000.0 * max(-counted[k], 0.0),
            str(stamp[k]).replace("T", " "),
        )
        for k in range(len(time))
    ]
    return (f"{header}Discharge_Capacity(mAh),Timestamp\n" + lines(rows)).encode()


def neware_report(table):
    """Cycles, steps and records below one another."""
    time, current, voltage, step, step_time, kind, counted = channels(table)
    text = "Cycle Index,Chg. Cap.(Ah),DChg. Cap.(Ah)\n,Step Index,Step Number,Step Type\n"
    text += ",,DataPoint,Time,Total Time,Current(A),Voltage(V),Capacity(Ah)\n"
    for k in range(len(time)):
        if k == 0:
            text += f"1,2.0,2.0,1,1,{WORDS[kind[0]][0]}\n"
        elif step[k] != step[k - 1]:
            text += f",{step[k]},{step[k]},{WORDS[kind[k]][0]}\n"
        row = (k + 1, clock(step_time[k]), clock(time[k]), current[k], voltage[k], abs(counted[k]))
        text += ",," + lines([row])
    return text.encode()


def maccor_text(table):
    """Magnitudes of the current with a state, days and unpadded seconds, a tab at line ends."""
    time, current, voltage, step, step_time, kind, counted = channels(table)
    form = "  {d}d {r:02d}:{m:02d}:{s}"
    head = "Today's Date:\t14 December 2020\tDate of Test:\t11 December 2020, 12:22:12 PM\n"
    head += "Filename:\tcell_01\tTester Channel:\t1\nProcedure:\tdrive.000\tDescription:\t\n"
    head += "Rec#\tCyc#\tStep\tTestTime\tStepTime\tAmp-hr\tWatt-hr\tAmps\tVolts\tState\tES\t\n"
    rows = [
        (
            k + 1,
            0,
            step[k],
            clock(time[k], form),
            clock(step_time[k], form),
            abs(counted[k]),
            0.0,
            abs(current[k]),
            voltage[k],
            WORDS[kind[k]][1],
            1,
        )
        for k in range(len(time))
    ]
    return (head + lines(rows, "\t", "\t")).encode()


def maccor_minutes(table):
    """German settings: decimal commas, and minutes that are not said."""
    time, current, voltage, step, step_time, kind, counted = channels(table)
    head = "Name:\tcell\nTester\tMaccor #4\nC Rate\t0,003\n\n"
    head += "Rec\tCycle P\tCycle C\tStep\tTestTime\tStepTime\tCap. [Ah]\tCurrent [A]\t"
    head += "Voltage [V]\tMd\n\n"
    rows = [
        (
            k + 1,
            0,
            1,
            step[k],
            repr(float(time[k] / 60)),
            repr(float(step_time[k] / 60)),
            abs(counted[k]),
            abs(current[k]),
            voltage[k],
            WORDS[kind[k]][1],
        )
        for k in range(len(time))
    ]
    return (head + lines(rows, "\t").replace(".", ",")).encode()


def biologic_mpt(table, comma=False):
    """A tab more at the end of the names than in the rows, and a degree sign of Windows."""
    time, current, voltage, step, *_ = channels(table)
    head = "EC-Lab ASCII FILE\nNb header lines : 6\n\nModulo Bat\nTemperature max = 70.00 °C\n"
    head += "mode\tox/red\terror\tNs\ttime/s\tEwe/V\t<I>/mA\tcontrol/V/mA\t\n"
    rows = [
        (1, 1, 0, step[k], time[k], voltage[k], 1e3 * current[k], 0.0) for k in range(len(time))
    ]
    body = lines(rows, "\t")
    return (head + (body.replace(".", ",") if comma else body)).encode("cp1252")


def digatron_csv(table):
    """Lines above, a stray zero byte, units below the names, a comma at line ends."""
    time, current, voltage, step, step_time, kind, _counted = channels(table)
    head = "\n\nMeasurement ID,562\nBattery Name,LG HG2\nMaximum Voltage, 4.2\n\0\n"
    head += "Step,Status,Step Time,Prog Time,Cycle,Voltage,Current,AhAccu,\n"
    head += "[],[],[ss.xxx],[ss.xxx],[],[V],[A],[Ah],\n"
    flowed = np.cumsum(np.diff(time, prepend=time[0]) * current) / 3600
    rows = [
        (step[k], WORDS[kind[k]][2], step_time[k], time[k], 0, voltage[k], current[k], flowed[k])
        for k in range(len(time))
    ]
    return (head + lines([*rows, rows[-1]], ",", ",")).encode()


def basytec_text(table):
    time, current, voltage, step, step_time, _kind, _counted = channels(table)
    head = "~Resultfile from Basytec Battery Test System\n~\n~Battery: cell\n~\n"
    head += "~Time[h]\tDataSet\tt-Step[h]\tLine\tCommand\tU[V]\tI[A]\tAh[Ah]\tT1[°C]\n"
    rows = [
        (
            repr(float(time[k] / 3600)),
            k,
            step_time[k] / 3600,
            step[k],
            "Pause",
            voltage[k],
            current[k],
            0.0,
            25.0,
        )
        for k in range(len(time))
    ]
    return (head + lines(rows, "\t")).encode("latin-1")


def novonix_csv(table):
    time, current, voltage, step, step_time, *_ = channels(table)
    head = "[Summary]\nNovonix HPC data file\nCapacity (Ah): 5\n[End Summary]\n[Protocol]\n"
    head += "{" + '"StepType":3,' * 900 + "}\n[End Protocol]\n[Data]\n"
    head += "Date and Time,Cycle Number,Step Type,Run Time (h),Step Time (h),Current (A),"
    head += "Potential (V),Step Number\n"
    rows = [
        (
            "2025-07-19 15:26:20",
            0,
            1,
            repr(float(time[k] / 3600)),
            step_time[k] / 3600,
            current[k],
            voltage[k],
            step[k],
        )
        for k in range(len(time))
    ]
    return (head + lines(rows)).encode()


def landt_workbook(table):
    """The records stand in the second sheet."""
    time, current, voltage, step, step_time, _kind, counted = channels(table)
    header = ["Record", "TestTime/Sec", "StepTime/Sec", "Current/mA", "Capacity/mAh", "Voltage/V"]
    header += ["AuxTemp/dC.", "SysTime", "Step-Index", "Step-State"]
    rows = [
        [
            k + 1,
            float(time[k]),
            float(step_time[k]),
            float(1000.0 * current[k]),
            float(1000.0 * abs(counted[k])),
            float(voltage[k]),
            "-",
            "2021-02-25 13:41:24",
            int(step[k]),
            "R",
        ]
        for k in range(len(time))
    ]
    cycles = [["Cycle", "CapC/mAh", "CapD/mAh"], [1, 2.7, 3.0]]
    return workbook({"Cycle-Tab": cycles, "Record-Tab": [header, *rows]})


def arbin_csv(table):
    time, current, voltage, step, step_time, *_ = channels(table)
    header = "Data Point,Date Time,Test Time (s),Step Time (s),Cycle Index,Step Index,Current (A),"
    header += "Voltage (V),Aux_Temperature_1 (C)"
    rows = [
        (
            k + 1,
            "\t09/20/2024 08:32:34.558",
            time[k],
            step_time[k],
            1,
            step[k],
            current[k],
            voltage[k],
            24.5,
        )
        for k in range(len(time))
    ]
    return (f"\ufeff{header}\n" + lines(rows)).encode()


def pec_csv(table):
    """A second small table above, milliamperes and millivolts, more cells than names."""
    time, current, voltage, step, step_time, *_ = channels(table)
    head = "Request Year:,2019\nTest:,187\n#RESULTS CHECK\nReqYear,Test,CellNr,Type,Value\n"
    head += "2019,187,1,1,3272\n#END RESULTS CHECK\n"
    head += "Test,Cell,Step,Cycle,Total Time (Hours in hh:mm:ss.xxx),Load On Time (Seconds),"
    head += "Step Time (Seconds),Voltage (mV),Current (mA)\n"
    rows = [
        (
            187,
            1,
            step[k],
            0,
            clock(time[k]),
            0,
            step_time[k],
            1000.0 * voltage[k],
            1000.0 * current[k],
            0,
            25.83,
        )
        for k in range(len(time))
    ]
    return (head + lines(rows, ",", ",")).encode()


def gamry_dta(table):
    """Rows begin with a tab, units stand below the names, and a line follows the table."""
    time, current, voltage, *_ = channels(table)
    head = "EXPLAIN\nTAG\tPWR800_CHARGE\nCAPACITY\tQUANT\t1.00000E+001\tCapacity (A-hr)\n"
    head += f"CURVE\tTABLE\t{len(time)}\n\tPt\tT\tVf\tIm\tVu\n\t#\ts\tV vs. Ref.\tA\tV\n"
    rows = [("", k, time[k], voltage[k], current[k], 0.0) for k in range(len(time))]
    return (head + lines(rows, "\t") + "EXPERIMENTABORTED\tTOGGLE\tT\n").encode()


def thousands(table):
    """Milliamperes with separators between thousands, in quotes."""
    time, current, voltage, *_ = channels(table)
    rows = [(time[k], f'"{1e3 * current[k]:,.12f}"', voltage[k]) for k in range(len(time))]
    return ("Time [s],Current [mA],Voltage [V]\n" + lines(rows)).encode()


WRITERS = {
    "Neware CSV": neware_csv,
    "Neware CSV, step clock": neware_step_clock,
    "NewareNDA CSV": neware_nda_csv,
    "Neware report": neware_report,
    "Maccor text": maccor_text,
    "Maccor text, German": maccor_minutes,
    "BioLogic .mpt": biologic_mpt,
    "BioLogic .mpt, German": lambda table: biologic_mpt(table, comma=True),
    "Digatron CSV": digatron_csv,
    "Basytec text": basytec_text,
    "Novonix CSV": novonix_csv,
    "Landt workbook": landt_workbook,
    "Arbin CSV": arbin_csv,
    "PEC CSV": pec_csv,
    "Gamry .DTA": gamry_dta,
    "thousands": thousands,
    "BDF CSV": lambda table: table.write_csv().encode(),
}


def pulse_table(samples=300):
    """Pulses of either direction with rests, every second."""
    from helpers.records import pulses_a, simulated_cell

    current_a = pulses_a(samples)
    return pl.DataFrame(
        {
            TIME: np.arange(samples, dtype=float),
            CURRENT: -current_a + 0.0,
            VOLTAGE: simulated_cell(current_a),
        }
    )
