"""A record written as the makes of testers write theirs: own small files in their dialects.

Each writer takes a table under Battery Data Format labels, charge positive, and gives a file.
"""

import numpy as np
import polars as pl

from helpers.records import CURRENT, TIME, VOLTAGE, pulse_frame, workbook

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


def clocks(seconds, form="{h:02d}:{m:02d}:{s}"):
    """Times as a clock shows them."""
    shown = []
    for each in seconds:
        whole, part = divmod(float(each), 60)
        # Clocks have no exponents.
        part = np.format_float_positional(part, trim="0")
        hours, minutes = divmod(int(whole), 60)
        shown.append(form.format(d=hours // 24, h=hours, r=hours % 24, m=minutes, s=part))
    return shown


def words(kind, make):
    """The kinds of steps in the words of a make."""
    return [WORDS[each][make] for each in kind]


def number(time, first=1):
    return first + np.arange(len(time))


def lines(*columns, delimiter=",", end=""):
    """Rows of these columns; what is one value stands in every row."""
    count = max(map(np.size, columns))
    filled = [[each] * count if np.isscalar(each) else each for each in columns]
    rows = zip(*filled, strict=True)
    return "".join(delimiter.join(map(str, row)) + end + "\n" for row in rows)


def neware_csv(table):
    time, current, voltage, step, step_time, kind, counted = channels(table)
    head = "DataPoint,Cycle Index,Step Index,Step Type,Time,Total Time,Current(A),Voltage(V)"
    head += ",Capacity(Ah)\n"
    named = number(time), 1, step, words(kind, 0), clocks(step_time), clocks(time)
    return (head + lines(*named, current, voltage, abs(counted))).encode()


def neware_step_clock(table):
    """An older export: milliamperes, and no clock but the step's."""
    _, current, voltage, step, step_time, kind, counted = channels(table)
    head = "Record ID,Step ID,Step Name,Time(h:min:s.ms),Voltage(V),Current(mA),Capacity(mAh)"
    head += ",Realtime\n"
    named = number(step), step, words(kind, 0), clocks(step_time)
    amounts = voltage, 1000.0 * current, 1000.0 * abs(counted)
    return (head + lines(*named, *amounts, "2024-02-29 09:20:29")).encode()


def neware_nda_csv(table):
    """As NewareNDA and pandas write it: an index without a name, and the clock of the steps."""
    time, current, voltage, step, step_time, kind, counted = channels(table)
    head = ",Index,Cycle,Step,Status,Time,Voltage,Current(mA),Charge_Capacity(mAh),"
    head += "Discharge_Capacity(mAh),Timestamp\n"
    status = [word.replace(" ", "_") for word in words(kind, 0)]
    amounts = [1000.0 * np.maximum(each, 0.0) for each in (counted, -counted)]
    stamp = np.datetime64("2024-02-29T09:20:29") + np.round(1e6 * time).astype("timedelta64[us]")
    stamps = [str(each).replace("T", " ") for each in stamp]
    named = number(time, 0), number(time), 1, step, status, step_time
    return (head + lines(*named, voltage, 1000.0 * current, *amounts, stamps)).encode()


def neware_report(table):
    """Cycles, steps and records below one another."""
    time, current, voltage, step, step_time, kind, counted = channels(table)
    text = "Cycle Index,Chg. Cap.(Ah),DChg. Cap.(Ah)\n,Step Index,Step Number,Step Type\n"
    text += ",,DataPoint,Time,Total Time,Current(A),Voltage(V),Capacity(Ah)\n"
    named = number(time), clocks(step_time), clocks(time)
    rows = lines(*named, current, voltage, abs(counted)).splitlines(keepends=True)
    for k, row in enumerate(rows):
        if k == 0:
            text += f"1,2.0,2.0,1,1,{WORDS[kind[0]][0]}\n"
        elif step[k] != step[k - 1]:
            text += f",{step[k]},{step[k]},{WORDS[kind[k]][0]}\n"
        text += ",," + row
    return text.encode()


def maccor_text(table):
    """Magnitudes of the current with a state, days and unpadded seconds, a tab at line ends."""
    time, current, voltage, step, step_time, kind, counted = channels(table)
    form = "  {d}d {r:02d}:{m:02d}:{s}"
    head = "Today's Date:\t14 December 2020\tDate of Test:\t11 December 2020, 12:22:12 PM\n"
    head += "Filename:\tcell_01\tTester Channel:\t1\nProcedure:\tdrive.000\tDescription:\t\n"
    head += "Rec#\tCyc#\tStep\tTestTime\tStepTime\tAmp-hr\tWatt-hr\tAmps\tVolts\tState\tES\t\n"
    named = number(time), 0, step, clocks(time, form), clocks(step_time, form)
    amounts = abs(counted), 0.0, abs(current), voltage
    return (head + lines(*named, *amounts, words(kind, 1), 1, delimiter="\t", end="\t")).encode()


def maccor_minutes(table):
    """German settings: decimal commas, and minutes that are not said."""
    time, current, voltage, step, step_time, kind, counted = channels(table)
    head = "Name:\tcell\nTester\tMaccor #4\nC Rate\t0,003\n\n"
    head += "Rec\tCycle P\tCycle C\tStep\tTestTime\tStepTime\tCap. [Ah]\tCurrent [A]\t"
    head += "Voltage [V]\tMd\n\n"
    named = number(time), 0, 1, step, time / 60, step_time / 60
    rows = lines(*named, abs(counted), abs(current), voltage, words(kind, 1), delimiter="\t")
    return (head + rows.replace(".", ",")).encode()


def biologic_mpt(table, comma=False):
    """A tab more at the end of the names than in the rows, and a degree sign of Windows."""
    time, current, voltage, step, *_ = channels(table)
    head = "EC-Lab ASCII FILE\nNb header lines : 6\n\nModulo Bat\nTemperature max = 70.00 °C\n"
    head += "mode\tox/red\terror\tNs\ttime/s\tEwe/V\t<I>/mA\tcontrol/V/mA\t\n"
    rows = lines(1, 1, 0, step, time, voltage, 1e3 * current, 0.0, delimiter="\t")
    return (head + (rows.replace(".", ",") if comma else rows)).encode("cp1252")


def digatron_csv(table):
    """Lines above, a stray zero byte, units below the names, a comma at line ends, and the last
    row twice."""
    time, current, voltage, step, step_time, kind, _ = channels(table)
    head = "\n\nMeasurement ID,562\nBattery Name,LG HG2\nMaximum Voltage, 4.2\n\0\n"
    head += "Step,Status,Step Time,Prog Time,Cycle,Voltage,Current,AhAccu,\n"
    head += "[],[],[ss.xxx],[ss.xxx],[],[V],[A],[Ah],\n"
    flowed = np.cumsum(np.diff(time, prepend=time[0]) * current) / 3600
    named = step, words(kind, 2), step_time, time, 0
    rows = lines(*named, voltage, current, flowed, end=",").splitlines(keepends=True)
    return "".join([head, *rows, rows[-1]]).encode()


def basytec_text(table):
    time, current, voltage, step, step_time, *_ = channels(table)
    head = "~Resultfile from Basytec Battery Test System\n~\n~Battery: cell\n~\n"
    head += "~Time[h]\tDataSet\tt-Step[h]\tLine\tCommand\tU[V]\tI[A]\tAh[Ah]\tT1[°C]\n"
    named = time / 3600, number(time, 0), step_time / 3600, step, "Pause"
    return (head + lines(*named, voltage, current, 0.0, 25.0, delimiter="\t")).encode("latin-1")


def novonix_csv(table):
    time, current, voltage, step, step_time, *_ = channels(table)
    head = "[Summary]\nNovonix HPC data file\nCapacity (Ah): 5\n[End Summary]\n[Protocol]\n"
    head += "{" + '"StepType":3,' * 900 + "}\n[End Protocol]\n[Data]\n"
    head += "Date and Time,Cycle Number,Step Type,Run Time (h),Step Time (h),Current (A),"
    head += "Potential (V),Step Number\n"
    named = "2025-07-19 15:26:20", 0, 1, time / 3600, step_time / 3600
    return (head + lines(*named, current, voltage, step)).encode()


def landt_workbook(table):
    """The records stand in the second sheet."""
    time, current, voltage, step, step_time, _, counted = channels(table)
    header = ["Record", "TestTime/Sec", "StepTime/Sec", "Current/mA", "Capacity/mAh", "Voltage/V"]
    header += ["AuxTemp/dC.", "SysTime", "Step-Index", "Step-State"]
    amounts = time, step_time, 1000.0 * current, 1000.0 * abs(counted), voltage
    columns = [each.tolist() for each in (number(time), *amounts, step)]
    rows = [
        [*named, "-", "2021-02-25 13:41:24", index, "R"]
        for *named, index in zip(*columns, strict=True)
    ]
    cycles = [["Cycle", "CapC/mAh", "CapD/mAh"], [1, 2.7, 3.0]]
    return workbook({"Cycle-Tab": cycles, "Record-Tab": [header, *rows]})


def arbin_csv(table):
    time, current, voltage, step, step_time, *_ = channels(table)
    head = "Data Point,Date Time,Test Time (s),Step Time (s),Cycle Index,Step Index,Current (A),"
    head += "Voltage (V),Aux_Temperature_1 (C)\n"
    named = number(time), "\t09/20/2024 08:32:34.558", time, step_time, 1, step
    return ("\ufeff" + head + lines(*named, current, voltage, 24.5)).encode()


def pec_csv(table):
    """A second small table above, milliamperes and millivolts, more cells than names."""
    time, current, voltage, step, step_time, *_ = channels(table)
    head = "Request Year:,2019\nTest:,187\n#RESULTS CHECK\nReqYear,Test,CellNr,Type,Value\n"
    head += "2019,187,1,1,3272\n#END RESULTS CHECK\n"
    head += "Test,Cell,Step,Cycle,Total Time (Hours in hh:mm:ss.xxx),Load On Time (Seconds),"
    head += "Step Time (Seconds),Voltage (mV),Current (mA)\n"
    named = 187, 1, step, 0, clocks(time), 0, step_time
    amounts = 1000.0 * voltage, 1000.0 * current
    return (head + lines(*named, *amounts, 0, 25.83, end=",")).encode()


def gamry_dta(table):
    """Rows begin with a tab, units stand below the names, and a line follows the table."""
    time, current, voltage, *_ = channels(table)
    head = "EXPLAIN\nTAG\tPWR800_CHARGE\nCAPACITY\tQUANT\t1.00000E+001\tCapacity (A-hr)\n"
    head += f"CURVE\tTABLE\t{len(time)}\n\tPt\tT\tVf\tIm\tVu\n\t#\ts\tV vs. Ref.\tA\tV\n"
    rows = lines("", number(time, 0), time, voltage, current, 0.0, delimiter="\t")
    return (head + rows + "EXPERIMENTABORTED\tTOGGLE\tT\n").encode()


def thousands(table):
    """Milliamperes with separators between thousands, in quotes."""
    time, current, voltage, *_ = channels(table)
    quoted = [f'"{each:,.12f}"' for each in 1e3 * current]
    return ("Time [s],Current [mA],Voltage [V]\n" + lines(time, quoted, voltage)).encode()


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
    # A rest of -0.0 A would be written with its sign.
    return pulse_frame(samples).with_columns(pl.col(CURRENT) + 0.0)
