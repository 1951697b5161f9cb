"""What a machine is made of, in SI units; every default is the ideal part.

One definition serves twice: ``compiled.py`` writes the C structures from these fields, in this
order, every field a double. A choice is therefore a number with a name (``ONE_QUADRANT``), and a
switch is a float that is 0 or 1.
"""

from dataclasses import dataclass, field

FOUR_QUADRANT, ONE_QUADRANT = 4.0, 1.0
"""Switches replace the diodes: current of both signs; diodes carry the current on: it only decays
while the command is on, so that the motor coasts whenever it turns faster than the command."""

TACHO, TICKS, PERIOD, ANGLE = 0.0, 1.0, 2.0, 3.0
"""What a sensor gives: the speed itself, ticks differenced over its clock, the inverse of the time
between ticks, or the angle."""


@dataclass(frozen=True)
class Firmware:
    """What the controller board does with a command d in −1 … 1 before the bridge sees it."""

    largest: float = 1.0
    """Largest duty it lets through."""
    expo: float = 0.0
    """Curve of a remote control: d + expo (d − d³)."""
    slew: float = 0.0
    """Steepest change of the duty [1/s]; 0 is none."""
    soft_start: float = 0.0
    """Time constant of its low-pass on the duty [s]."""
    shortest_pulse: float = 0.0
    """A pulse shorter than this share of the period is left out."""
    turn_on: float = 0.0
    """Share of the period that every pulse loses while the switch turns on."""
    bits: float = 0.0
    """Resolution of the PWM: 2^bits steps from 0 to 1; 0 is none."""


@dataclass(frozen=True)
class Bridge:
    """An H-bridge, averaged over a PWM period."""

    quadrants: float = FOUR_QUADRANT
    coast_at_zero: float = 0.0
    """Whether all switches open at a duty of 0 (1), or the motor is shorted (0)."""
    on_resistance: float = 0.0
    """Of the switches that carry the current [Ω]."""
    diode_drop: float = 0.0
    """Of a free-wheeling diode [V]."""
    dead_time: float = 0.0
    """Share of the period in which neither switch of a leg conducts; the current's sign then
    decides the voltage."""
    ripple_current: float = 0.05
    """Current below which the ripple crosses zero within the period, so that dead time counts
    only in part [A]."""
    current_limit: float = 0.0
    """Largest current: it chops beyond [A]; 0 is none."""
    pwm_period: float = 0.0
    """With one quadrant: period at which the current may run dry between pulses [s]; 0: never."""


@dataclass(frozen=True)
class Motor:
    """A permanent-magnet DC motor: L di/dt = v − R i − K ω, torque K i."""

    resistance: float = 2.0
    """Of the winding at 20 °C [Ω]."""
    inductance: float = 0.0
    """[H]; 0: the current follows at once."""
    constant: float = 0.01
    """Kt = Ke [N m/A = V s/rad]."""
    backward_constant: float = 1.0
    """The same turning backward, over that forward: brushes off the neutral."""
    inertia: float = 1e-6
    """[kg m²]."""
    cogging: float = 0.0
    """Amplitude of the cogging torque [N m]."""
    cogging_periods: float = 12.0
    """Periods of it in a turn of the motor."""


@dataclass(frozen=True)
class Friction:
    """Dry, viscous and quadratic friction of a shaft. Torques are magnitudes."""

    coulomb_forward: float = 0.0
    """[N m]."""
    coulomb_backward: float = 0.0
    """[N m]."""
    viscous_forward: float = 0.0
    """[N m s/rad]."""
    viscous_backward: float = 0.0
    """[N m s/rad]."""
    quadratic: float = 0.0
    """[N m s²/rad²]."""
    breakaway: float = 1.0
    """Largest friction at rest over the Coulomb friction (Stribeck)."""
    stribeck_speed: float = 1.0
    """Speed at which the excess has fallen to 1/e [rad/s]."""
    load_share: float = 0.0
    """Dry friction per torque that is transmitted."""
    presliding: float = 0.0
    """Twist at which bristles slip (LuGre) [rad]; 0: it sticks rigidly."""
    bristle_damping: float = 0.0
    """Damping of the bristles [N m s/rad]."""


@dataclass(frozen=True)
class Gearbox:
    """From the motor's shaft to the output: rigid (stiffness 0) or elastic, perhaps with play."""

    ratio: float = 30.0
    """Turns of the motor per turn of the output."""
    load_inertia: float = 4e-4
    """Behind the gap [kg m²]."""
    gap: float = 0.0
    """Free play at the output [rad]; needs a stiffness."""
    stiffness: float = 0.0
    """Of the teeth in contact, at the output [N m/rad]."""
    damping: float = 0.0
    """Of the contact [N m s/rad]; a contact pushes only."""
    eccentricity: float = 0.0
    """Of a gear or sprocket: the ratio changes by this share within a turn of the output."""
    eccentric_phase: float = 0.0
    """[rad]."""
    eccentric_periods: float = 1.0
    """How many times a turn."""


@dataclass(frozen=True)
class Load:
    """Torque on the output."""

    constant: float = 0.0
    """[N m], in the sense of forward motion."""
    gravity: float = 0.0
    """Amplitude of m g l sin(angle + phase) [N m], against the angle."""
    gravity_phase: float = 0.0
    """[rad]."""
    spring: float = 0.0
    """[N m/rad]: outside the catalogue."""
    memory: float = 0.0
    """Torque of a creeping belt [N m/rad] that relaxes with ``memory_time``: outside it."""
    memory_time: float = 1.0
    """[s]."""


@dataclass(frozen=True)
class Thermal:
    """Winding and housing; capacities of 0 hold the temperature."""

    winding_capacity: float = 0.0
    """[J/K]."""
    housing_capacity: float = 0.0
    """[J/K]."""
    winding_to_housing: float = 1.0
    """Thermal resistance [K/W]."""
    housing_to_air: float = 1.0
    """[K/W]."""
    copper: float = 0.0039
    """Rise of the resistance [1/K]."""
    magnets: float = -0.002
    """Change of the magnets' strength with the housing [1/K]."""
    air: float = 20.0
    """[°C]."""


@dataclass(frozen=True)
class Sensor:
    """Of one output shaft: an encoder or a tacho."""

    kind: float = TACHO
    lines: float = 1000.0
    """Ticks in a turn."""
    eccentricity: float = 0.0
    """Error of the angle read, once or several times a turn [rad]."""
    eccentric_phase: float = 0.0
    """[rad]."""
    eccentric_periods: float = 1.0
    filter_time: float = 0.0
    """Low-pass: of a tacho analogue, of ticks at each reading [s]."""
    timeout: float = 0.5
    """Time without a tick after which a period sensor says 0 [s]."""
    signless: float = 0.0
    """Whether it does not see the direction (1)."""


@dataclass(frozen=True)
class Drive:
    """From a command to a wheel and its reading."""

    firmware: Firmware = field(default_factory=Firmware)
    bridge: Bridge = field(default_factory=Bridge)
    motor: Motor = field(default_factory=Motor)
    motor_friction: Friction = field(default_factory=Friction)
    gearbox: Gearbox = field(default_factory=Gearbox)
    friction: Friction = field(default_factory=Friction)
    """Of the output shaft."""
    load: Load = field(default_factory=Load)
    thermal: Thermal = field(default_factory=Thermal)
    sensor: Sensor = field(default_factory=Sensor)


@dataclass(frozen=True)
class Battery:
    """Open-circuit curve, resistance, one slow polarisation; it is charged when it starts."""

    full: float = 12.0
    """Open-circuit voltage when charged [V]."""
    slope: float = 0.0
    """By how much that falls until empty, evenly [V]."""
    knee: float = 0.0
    """By how much it falls besides at the very end, with exp(−charge/0.05) [V]."""
    capacity: float = 1e9
    """[A s]."""
    charge: float = 1.0
    """Share it starts with."""
    resistance: float = 0.0
    """At once [Ω]."""
    slow_resistance: float = 0.0
    """Of the polarisation [Ω]."""
    slow_time: float = 10.0
    """Of the polarisation [s]."""


@dataclass(frozen=True)
class Body:
    """A body on two tracks. Without a mass the wheels turn in the air and only tell the pose."""

    mass: float = 0.0
    """[kg]; 0: the pose follows the wheels and does not act back."""
    yaw_inertia: float = 0.0
    """[kg m²]."""
    radius_left: float = 0.0215
    """Of the wheel or sprocket [m]."""
    radius_right: float = 0.0215
    """[m]."""
    width: float = 0.186
    """Distance of the tracks [m]."""
    length: float = 0.14
    """Of the contact [m]."""
    grip: float = 0.8
    """Friction of the track along its way."""
    side_grip: float = 0.0
    """The same sideways: it resists turning."""
    slip_speed: float = 0.005
    """Speed at which a point of the track slides by half [m/s]."""
    creep: float = 0.0
    """The same as a share of the track's speed: what soft ground or rubber gives."""
    height: float = 0.0
    """Of the centre of mass above the ground [m]: moves load between the tracks."""
    ahead: float = 0.0
    """Centre of mass ahead of the middle of the contact [m]."""
    slope: float = 0.0
    """Of the ground [rad], uphill along x."""
    rolling: float = 0.0
    """Rolling resistance over the load."""
    yaw_viscosity: float = 0.0
    """[N m s/rad]."""
    gravity: float = 9.81
    """[m/s²]."""


@dataclass(frozen=True)
class Controller:
    """A speed (or position) loop on the readings; all zero: commands are open."""

    proportional: float = 0.0
    """Duty per unit of the reading."""
    integral: float = 0.0
    """The same per second."""
    derivative: float = 0.0
    """The same times a second, on the reading."""


@dataclass(frozen=True)
class Machine:
    """One or two drives, what feeds them and what they move. The default is the null machine."""

    drives: tuple[Drive, ...] = (Drive(), Drive())
    battery: Battery = field(default_factory=Battery)
    body: Body = field(default_factory=Body)
    controller: Controller = field(default_factory=Controller)
