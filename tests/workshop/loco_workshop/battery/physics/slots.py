# SPDX-License-Identifier: Apache-2.0
"""Array indices of the constants of drives, springs and hidden laws.

A hidden law has a row of four constants per joint; all zeros means that it is absent.
"""

from __future__ import annotations

FREE, TORQUE, IMPEDANCE, SERVO = 0.0, 1.0, 2.0, 3.0  # kinds of drive
# Columns of a drive: kind, seven constants, effort limit, period of its samples (0: none).
# SERVO: stall torque, slope, kp, resolution, rotor, stiffness and damping of the gear
# IMPEDANCE: kp, kd, ki, speed_ki, position_gain, speed_feed, integral_limit
# TORQUE: gain, bias, slope
DRIVE = 10
SPRING = 6  # kind (1 linear, 2 knee), stiffness, damping, rest or free length, femur, tibia

(
    COULOMB,  # torque
    VISCOUS,  # damping
    STRIBECK,  # torque, velocity
    LOAD,  # share
    BACKLASH,  # width, inertia
    COMMAND_DELAY,  # delay, of all joints: row 0
    ACTUATION_DELAY,  # delay
    LAG,  # time
    LIMIT,  # reduction
    LINE,  # slope
    SAG,  # sag, of all joints: row 0
    GAIN,  # error
    OFFSET,  # offset
    STIFFNESS,  # stiffness, rest, cubic
    SPRING_ERROR,  # error, -, rest offset
    SATURATION,  # lost, torque
    STOP,  # angle, stiffness, damping
    HYSTERESIS,  # torque, stroke
    MAXWELL,  # stiffness, time
    SERIES,  # compliance, inertia, damping
    DRIFT,  # dry friction at the start, time in which it fades
    RIPPLE,  # torque, teeth, phase
    DRAG,  # torque per speed squared
    ABSORBER,  # stiffness, damping, inertia
    RUBBER,  # torque, stroke, share of hardening
    ONE_WAY,  # viscous friction of motions to the positive side
    JUMP,  # torque error before and after `time`
    DEADBAND,  # torque below which a drive gives none
    SPOT,  # dry friction, centre and width of the worn part
    HUM,  # torque, angular frequency, phase
    BIAS,  # torque
    LAWS,
) = range(32)

# State variables, one row each; columns are joints. WOUND is the torque of an integrator.
(
    Q, V, ROTOR, ROTOR_V, LAGGED, BENT, FADING, MOTOR, MOTOR_V, LOOSE, LOOSE_V,
    RUBBER_A, RUBBER_B, RUBBER_C, WOUND, STATES,
) = range(16)  # fmt: skip
