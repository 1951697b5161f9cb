"""Planar dynamics of a tracked vehicle on its floor (thesis 2.37–2.42), driven by its motors.

Body axes through the centre of mass, x forward, y left; V_i = v_x ∓ ψ̇B/2 are the speeds of the
tracks over the ground (left −, right +):

    m (v̇_x − v_y ψ̇) = T_L + T_R − R_L − R_R + m g_x
    m (v̇_y + v_x ψ̇) = −F_y + m g_y
    J ψ̈            = (T_R − R_R) B/2 − (T_L − R_L) B/2 − M_r
    J_i ω̇_i        = S_i (sat(d_i) − o_i) − D_i ω_i − C_i − r T_i

with thrust T from the slip of track against ground (2.33 or another law of shear), rolling
resistance R (2.34), lateral friction F_y and its moment M_r (2.35, 2.36), and the motors' dry
friction C. R, C, (F_y, M_r) and, where a track does not yet turn, T are set-valued at standstill:
whatever within their limits keeps it. A step therefore asks for the velocities at its *end* and
the frictions that belong to them together,

    M (v⁺ − v) = h (force − friction)    friction opposes v⁺, or is within its limits where v⁺ = 0

(implicit time stepping: Moreau 1988; Acary & Brogliato 2008, ch. 10), so that nothing chatters and
no threshold speed is needed: sticking is a state. The frictions are found by rounds over blocks
that are each solved exactly — the two motors, the two thrusts, the two rolling resistances
(:mod:`sysid.vehicle.dry_friction`), the lateral pair (:mod:`sysid.vehicle.contact`) —
beginning with those of the step before, which are part of the state. The slip's share of thrust is
the secant of its law at the step's beginning. First order in h; the lateral pair takes the pressure
as uniform over L around the centre of mass, which keeps the vehicle from tipping.
"""

from typing import Any, NamedTuple

from sysid.runners.loops import repeated
from sysid.runners.trees import chosen, mapped
from sysid.vehicle.contact import Pair, grip, loads, nearest, tracks_at
from sysid.vehicle.dry_friction import friction
from sysid.vehicle.floor import Floor
from sysid.vehicle.kinematics import Real, wrap_angle
from sysid.vehicle.motors import Motor, applied_torque, friction_limits
from sysid.vehicle.tracked import TrackedVehicle


class Forces(NamedTuple):
    """What acted in a step, and what the next one begins its search with.

    Attributes:
        motors: torque of dry friction in each motor, against its speed [Nm].
        thrust: of each track on the body [N].
        rolling: resistance of each track, against its speed [N].
        side: lateral friction against v_y [N].
        turning: its moment against ψ̇ [Nm].
    """

    motors: Pair = (0.0, 0.0)
    thrust: Pair = (0.0, 0.0)
    rolling: Pair = (0.0, 0.0)
    side: Real = 0.0
    turning: Real = 0.0


class VehicleState(NamedTuple):
    """A vehicle in motion.

    Attributes:
        x, y: X, Y of the middle between its tracks [m].
        psi: ψ in (−π, π] [rad].
        vx, vy: velocity of the centre of mass along the body's axes [m/s].
        yaw_rate: ψ̇ [rad/s].
        omega: sprocket speeds, left and right [rad/s].
    """

    x: Real = 0.0
    y: Real = 0.0
    psi: Real = 0.0
    vx: Real = 0.0
    vy: Real = 0.0
    yaw_rate: Real = 0.0
    omega: Pair = (0.0, 0.0)
    forces: Forces = Forces()


class Scheme(NamedTuple):
    """How finely a step is computed.

    Attributes:
        rounds: over the blocks of friction in each. Each leaves about a quarter of what the
            velocities still err by, and the frictions of the last part are a good beginning.
    """

    substeps: int = 20
    rounds: int = 8


def substeps_for(dt: float, longest: float = 0.005) -> Scheme:
    """The scheme whose parts are not longer than this [s]; the shortest lag is some ten of them."""
    return Scheme(max(1, round(dt / longest + 0.499)))


USUAL = Scheme()
"""For the thesis's sample time of 0.1 s: parts of 5 ms."""


class _Contact(NamedTuple):
    """One track on the ground at the beginning of a part."""

    ease: Real
    most: Real
    rolling: Real
    lateral: Real


class _Speeds(NamedTuple):
    """Velocities while their frictions are found."""

    vx: Real
    vy: Real
    yaw_rate: Real
    omega: Pair


class _Search(NamedTuple):
    speeds: _Speeds
    forces: Forces
    sticks: tuple[Pair, Pair, Pair, Real]


class _Part(NamedTuple):
    """What stays the same during a part of length h: limits of friction, and what moves how.

    Attributes:
        motor: h/J_i of each motor.
        body: h(1/m + B²/4J) and h(1/m − B²/4J): of a force on one track, what its own and what
            the other track's speed change by.
        mass, inertia: h/m, h/J.
        grip: own change of slip by a thrust, without the law of shear, of each track.
        limits: of the motors' friction, (back, forth) of each.
        q: lateral friction per metre [N/m].
    """

    motor: Pair
    body: Pair
    mass: Real
    inertia: Real
    grip: Pair
    limits: tuple[Pair, Pair]
    contact: tuple[_Contact, _Contact]
    q: Real


SLIGHTEST = 1e-6
"""Slip below which the law of shear counts as straight: it is, to the seventh digit."""

HARDEST = 1e4
"""Slip above which a track only slides: locked or spinning on the spot."""

STANDING = 1e-9
"""Speed of a track that counts as standing [m/s]: it keeps the slip of one that stands a number,
and a motor without friction of its own comes to rest with its track."""


def step(
    state: VehicleState,
    drive: Pair,
    dt: Real,
    vehicle: TrackedVehicle,
    motors: tuple[Motor, Motor],
    floor: Floor,
    xp: Any,
    scheme: Scheme = USUAL,
) -> VehicleState:
    """The vehicle ``dt`` seconds later, its drive held.

    A pure function: every number of the state, vehicle, motors and soils may be traced.

    Args:
        state: before; :class:`VehicleState` with its defaults is at rest in the origin.
        drive: share of full drive of the left and the right motor [1].
        dt: duration [s]; 0 changes nothing.

    Returns:
        The state after it, with the forces of its last part.
    """
    passes = dt > 0
    h = xp.where(passes, dt / scheme.substeps, 1.0)
    model = _Model(vehicle, motors, floor, xp)

    def part(now: VehicleState) -> VehicleState:
        return model.part(now, drive, h, scheme.rounds)

    # numbers of the namespace, which a compiled loop keeps the type of
    number = xp.float64
    begin = mapped(lambda v: v if type(v) is number else number(v), state)
    after: VehicleState = chosen(passes, repeated(xp, scheme.substeps, part, begin), state, xp)
    return after


class _Model(NamedTuple):
    """A vehicle, its motors and its floor, over a namespace."""

    vehicle: TrackedVehicle
    motors: tuple[Motor, Motor]
    floor: Floor
    xp: Any

    def part(self, now: VehicleState, drive: Pair, h: Real, rounds: int) -> VehicleState:
        """A part of a step: free motion, then the friction that its end needs."""
        xp = self.xp
        cos, sin = xp.cos(now.psi), xp.sin(now.psi)
        known, free = self._free(now, drive, h, (cos, sin))
        no = free.vx != free.vx
        nothing_sticks = (no, no), (no, no), (no, no), no
        speeds = _with_forces(known, free, now.forces, self.vehicle)
        search = _Search(speeds, now.forces, nothing_sticks)
        search = repeated(xp, rounds, lambda last: self._round(known, last), search)
        return self._moved(now, self._stopped(known, search), search.forces, h)

    # ------------------------------------------------------------------------- free motion

    def _free(
        self, now: VehicleState, drive: Pair, h: Real, heading: Pair
    ) -> tuple[_Part, _Speeds]:
        """Limits of friction, and the velocities that would be reached without any."""
        xp, car, (cos, sin) = self.xp, self.vehicle, heading
        gx, gy, into = self.floor.gravity(xp)
        ahead, aside = gx * cos + gy * sin, gy * cos - gx * sin
        load = loads(car, into, now.vx * now.yaw_rate - aside, xp)
        contact = self._contacts(now, load, heading)
        per_mass, per_inertia = h / car.mass, h / car.yaw_inertia
        lever = 0.25 * car.geometry.B * car.geometry.B * per_inertia
        # speed takes torque away, whose value at the end counts: inertia is larger by hD
        eased = [h / (m.inertia + h * m.damping) for m in self.motors]
        r = car.geometry.r
        known = _Part(
            motor=(eased[0], eased[1]),
            body=(per_mass + lever, per_mass - lever),
            mass=per_mass,
            inertia=per_inertia,
            grip=(
                r * r * eased[0] + per_mass + lever + contact[0].ease,
                r * r * eased[1] + per_mass + lever + contact[1].ease,
            ),
            limits=tuple(  # type: ignore[arg-type]
                friction_limits(m, w, xp) for m, w in zip(self.motors, now.omega, strict=True)
            ),
            contact=contact,
            q=(contact[0].lateral + contact[1].lateral) / car.contact_length,
        )
        turn = now.yaw_rate * h  # the body's axes turn under the velocity
        c, s = xp.cos(turn), xp.sin(turn)
        omega = tuple(
            e / h * m.inertia * w + e * applied_torque(m, d, xp)
            for e, m, w, d in zip(eased, self.motors, now.omega, drive, strict=True)
        )
        return known, _Speeds(
            now.vx * c + now.vy * s + h * ahead,
            now.vy * c - now.vx * s + h * aside,
            now.yaw_rate,
            (omega[0], omega[1]),
        )

    def _contacts(self, now: VehicleState, load: Pair, heading: Pair) -> tuple[_Contact, _Contact]:
        car = self.vehicle
        half = 0.5 * car.geometry.B
        places = tracks_at(now.x, now.y, heading, car)
        over = now.vx - half * now.yaw_rate, now.vx + half * now.yaw_rate
        contacts = [
            self._contact(at, weight, car.geometry.r * omega, speed)
            for at, weight, omega, speed in zip(places, load, now.omega, over, strict=True)
        ]
        return contacts[0], contacts[1]

    def _contact(self, at: Pair, load: Real, rolls: Real, over: Real) -> _Contact:
        """One track: how its slip answers a thrust (secant), and the limits of its friction."""
        xp = self.xp
        speed, apart = xp.abs(rolls), xp.abs(rolls - over)
        slip = xp.minimum(xp.maximum(apart / (speed + STANDING), SLIGHTEST), HARDEST)
        least = xp.maximum(apart, SLIGHTEST * speed)
        gripped = grip(self.floor, at, load, slip, self.vehicle, xp)
        return _Contact(
            least / (gripped.thrust + 1e-12), gripped.most, gripped.rolling, gripped.lateral
        )

    # ---------------------------------------------------------------------------- friction

    def _round(self, known: _Part, last: _Search) -> _Search:
        """Every block of friction once, each with what the others take just now."""
        xp, car = self.xp, self.vehicle
        r, half = car.geometry.r, 0.5 * car.geometry.B
        speeds, forces = last.speeds, last.forces

        passed_on, free, stands = [], [], []
        for e, w, taken, (back, forth) in zip(
            known.motor, speeds.omega, forces.motors, known.limits, strict=True
        ):
            without = w + e * taken
            needed = without / e
            stands.append((needed > -back) & (needed < forth))
            passed_on.append(xp.minimum(xp.maximum(needed, -back), forth))
            free.append(without - e * passed_on[-1])
        motors_stand = (stands[0], stands[1])
        omega = (free[0], free[1])

        direct, cross = known.body
        vl, vr = speeds.vx - half * speeds.yaw_rate, speeds.vx + half * speeds.yaw_rate
        was = forces.thrust
        slides = (
            r * omega[0] - vl + (known.grip[0] - known.contact[0].ease) * was[0] + cross * was[1],
            r * omega[1] - vr + (known.grip[1] - known.contact[1].ease) * was[1] + cross * was[0],
        )
        most = (known.contact[0].most, known.contact[1].most)
        thrust, tracks_stick = friction(xp, (known.grip, cross), slides, most, most)
        dl, dr = thrust[0] - was[0], thrust[1] - was[1]
        omega = (omega[0] - r * known.motor[0] * dl, omega[1] - r * known.motor[1] * dr)
        vl, vr = vl + direct * dl + cross * dr, vr + direct * dr + cross * dl

        was = forces.rolling
        coast = (vl + direct * was[0] + cross * was[1], vr + direct * was[1] + cross * was[0])
        most = (known.contact[0].rolling, known.contact[1].rolling)
        rolling, tracks_stand = friction(xp, ((direct, direct), cross), coast, most, most)
        dl, dr = rolling[0] - was[0], rolling[1] - was[1]
        vl, vr = vl - direct * dl - cross * dr, vr - direct * dr - cross * dl
        yaw_rate = (vr - vl) / car.geometry.B

        wanted = speeds.vy / known.mass + forces.side, yaw_rate / known.inertia + forces.turning
        ease = 1.0 / car.mass, 1.0 / car.yaw_inertia
        side = nearest(wanted, known.q, 0.5 * car.contact_length, ease, xp)
        after = _Speeds(
            0.5 * (vl + vr),
            speeds.vy - known.mass * (side.side - forces.side),
            yaw_rate - known.inertia * (side.turning - forces.turning),
            omega,
        )
        tried = Forces(
            (passed_on[0], passed_on[1]),
            (thrust[0], thrust[1]),
            (rolling[0], rolling[1]),
            side.side,
            side.turning,
        )
        gripped = (tracks_stick[0], tracks_stick[1])
        sticks = (motors_stand, gripped, (tracks_stand[0], tracks_stand[1]), side.sticks)
        return _Search(after, tried, sticks)

    def _stopped(self, known: _Part, search: _Search) -> _Speeds:
        """What sticks stands: rounding, and what the rounds left, is taken from its speed."""
        xp, speeds = self.xp, search.speeds
        motors, grips, tracks, straight = search.sticks
        stand = [
            on_ground | (motor & grip & (contact.ease == 0.0))
            for on_ground, motor, grip, contact in zip(
                tracks, motors, grips, known.contact, strict=True
            )
        ]
        both = (stand[0] & stand[1]) | (straight & (stand[0] | stand[1]))
        rests = [
            motor | (stands & grip & (xp.abs(self.vehicle.geometry.r * omega) < STANDING))
            for motor, stands, grip, omega in zip(motors, stand, grips, speeds.omega, strict=True)
        ]
        return _Speeds(
            xp.where(both, 0.0, speeds.vx),
            xp.where(straight, 0.0, speeds.vy),
            xp.where(both | straight, 0.0, speeds.yaw_rate),
            (
                xp.where(rests[0], 0.0, speeds.omega[0]),
                xp.where(rests[1], 0.0, speeds.omega[1]),
            ),
        )

    # ------------------------------------------------------------------------------ motion

    def _moved(self, now: VehicleState, after: _Speeds, forces: Forces, h: Real) -> VehicleState:
        """The pose after a part, along the mean velocity; it is that of the tracks' middle."""
        xp, centre = self.xp, self.vehicle.centre
        turned = 0.5 * (now.yaw_rate + after.yaw_rate) * h
        middle = now.psi + 0.5 * turned
        cos, sin = xp.cos(middle), xp.sin(middle)
        ahead = 0.5 * (now.vx + after.vx) * h
        aside = 0.5 * (now.vy + after.vy) * h - centre * turned
        return VehicleState(
            x=now.x + ahead * cos - aside * sin,
            y=now.y + ahead * sin + aside * cos,
            psi=wrap_angle(now.psi + turned),
            vx=after.vx,
            vy=after.vy,
            yaw_rate=after.yaw_rate,
            omega=after.omega,
            forces=forces,
        )


def _with_forces(known: _Part, free: _Speeds, forces: Forces, car: TrackedVehicle) -> _Speeds:
    """Free velocities after what the frictions of the last part take."""
    r, half = car.geometry.r, 0.5 * car.geometry.B
    net = forces.thrust[0] - forces.rolling[0], forces.thrust[1] - forces.rolling[1]
    omega = tuple(
        w - e * (c + r * t)
        for w, e, c, t in zip(free.omega, known.motor, forces.motors, forces.thrust, strict=True)
    )
    return _Speeds(
        free.vx + known.mass * (net[0] + net[1]),
        free.vy - known.mass * forces.side,
        free.yaw_rate + known.inertia * (half * (net[1] - net[0]) - forces.turning),
        (omega[0], omega[1]),
    )
