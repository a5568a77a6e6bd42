"""A result of Automatic Servo Tuning after the layout that its reader documents: two masses, measured exactly."""

import struct
from pathlib import Path

import numpy as np

DIGITS = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ!#$`()*+-/:;=?@[]^_{|}~"
MOTOR, LOAD, STIFFNESS, VISCOUS = 0.004, 0.003, 300.0, 0.02  # kg m^2, N m/rad, N m s/rad
FREQUENCIES_HZ = np.arange(1, 400) * 1.0


def base_85(values: np.ndarray) -> str:
    """Return doubles in base 85, a point for each word that is 0, in lines."""
    cells = []
    for word in struct.unpack(f">{2 * len(values)}I", struct.pack(f">{len(values)}d", *values)):
        cells.append("." if word == 0 else "".join(DIGITS[word // 85**place % 85] for place in range(4, -1, -1)))
    text = "".join(cells)
    return "\n".join(text[start : start + 200] for start in range(0, len(text), 200))


def response() -> np.ndarray:
    """Return speed over torque of the motor, (rad/s)/(N m)."""
    s = 2j * np.pi * FREQUENCIES_HZ
    load = STIFFNESS * LOAD * s**2 / (LOAD * s**2 + STIFFNESS)
    return s / (MOTOR * s**2 + VISCOUS * s + load)


def array(name: str, values: np.ndarray, kind: str = "double") -> str:
    count = len(values) // (2 if kind == "ComplexNumber" else 1)
    return (
        f'<NumericArray elementtype="{kind}" format="base85" name="{name}">\n<unsigned_int name="m_length">{count}'
        f'</unsigned_int>\n<raw name="m_pNumberArray"><![CDATA[\n{base_85(values)}\n]]></raw>\n</NumericArray>\n'
    )


def function(name: str, values: np.ndarray) -> str:
    parts = np.column_stack((values.real, values.imag)).ravel()
    inner = array("m_ValueVector", parts, "ComplexNumber") + array("m_FrequencyVector", FREQUENCIES_HZ)
    return f'<FrequencyResponseFunction name="{name}">\n{inner}</FrequencyResponseFunction>\n'


def csv_array(name: str, values: list[float]) -> str:
    raw = ",".join(f"{value:.12f}" for value in values)
    return (
        f'<NumericArray elementtype="double" format="CSV" name="{name}"><unsigned_int name="m_length">{len(values)}'
        f'</unsigned_int><raw name="m_pNumberArray">{raw}</raw></NumericArray>\n'
    )


def regulator(number: int, gain: float, notch_Hz: float) -> str:
    return f"""<SpeedLoopRegulator name="m_listpSpeedLoopRegulators_Element">
<!-- Members in SpeedLoopRegulator -->
<unsigned_int name="m_uRegulatorID">{number}</unsigned_int>
<float name="m_dKpGain">{gain}</float>
<float name="m_dIntegralTime">0.010000000000000000208167</float>
<ConTimeFilterList name="m_CurrentFilters"><LinkedList name="m_LinkedList">
<SecondOrderFilter name="m_LinkedList_node"><boolean name="m_bFilterIsEnabled">true</boolean>
<float name="m_NumeratorFrequency">{notch_Hz}</float></SecondOrderFilter>
<PT2Filter name="m_LinkedList_node"><boolean name="m_bFilterIsEnabled">false</boolean>
<float name="m_Frequency">1999.0</float></PT2Filter>
</LinkedList></ConTimeFilterList>
</SpeedLoopRegulator>
"""


def servo_tuning(file: Path, rotary_axis: bool = False, zero_Hz: float | None = None, lead_m: float = 0.01) -> None:
    """Write the tuning of a ball screw, or of a rotary axis behind a gear of 20."""
    ratio = 0.05 if rotary_axis else lead_m / (2.0 * np.pi)
    zero = np.sqrt(STIFFNESS / LOAD) / (2.0 * np.pi) if zero_Hz is None else zero_Hz
    pole = np.sqrt(STIFFNESS / LOAD * (1.0 + LOAD / MOTOR)) / (2.0 * np.pi)
    text = f"""<?xml version="1.0" encoding="ISO-8859-1"?>
<!-- 4.96.0.0.1 -->
<DynamicModelAxisController ver="4.96.0.0.1">
<string name="m_szAxisName">AX1</string>
<string name="m_szPlatformName">MACHINE</string>
<DynamicModelList name="m_PositionControllerList">
<DynamicModelPositionController840DSL name="m_DynamicModelBase_ListElement">
<string name="m_szAxisName">X1</string>
<float name="m_dAxisDistPerMotorDistUnitsMetersAndRadians">{ratio:.24f}</float>
<boolean name="m_bAxisIsRotary">{str(rotary_axis).lower()}</boolean>
<LinkedList name="m_listpPositionLoopRegulators">
<PositionLoopRegulator><unsigned_int name="m_uRegulatorID">1</unsigned_int><float name="m_Kv">1.0</float>
</PositionLoopRegulator>
<PositionLoopRegulator><unsigned_int name="m_uRegulatorID">2</unsigned_int><float name="m_Kv">3.0</float>
<float name="m_dTotalInertia">0.000000</float></PositionLoopRegulator>
</LinkedList>
<DynamicModelSpeedControllerS120 name="m_DynamicModelBase_ListElement">
<float name="m_dMotorInertia">{MOTOR}</float>
<float name="m_dTotalInertia">{MOTOR + LOAD}</float>
<boolean name="m_bMotorIsRotary">true</boolean>
{csv_array("m_estimatedMechPoles", [pole, 500.0])}{csv_array("m_estimatedMechZeros", [zero, 450.0])}
<float name="m_dMinUsableMechPlantFrequency">5.5</float>
<float name="m_dViscousCoeff">{VISCOUS}</float>
<PlantMeasRecord>
{function("m_pPlant", response())}{function("m_pMeasCoherence", np.where(FREQUENCIES_HZ == 77.0, 0.5, 1.0) + 0j)}
</PlantMeasRecord>
<LinkedList name="m_listpSpeedLoopRegulators">
{regulator(1, 1.0, 100.0)}{regulator(2, 2.0, 200.0)}{regulator(7, 3.0, 300.0)}
</LinkedList>
</DynamicModelSpeedControllerS120>
<ExcitationSource><float name="m_dMotorForceConstant">2.435892956742988779694770</float></ExcitationSource>
</DynamicModelPositionController840DSL>
</DynamicModelList>
</DynamicModelAxisController>
"""
    file.write_text(text)
