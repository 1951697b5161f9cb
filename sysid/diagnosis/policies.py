"""Thresholds and budgets of the diagnosis, each with its reason."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AcceptanceRule:
    """When an effect belongs to a model: the rule that held on real records, where AIC did not.

    Attributes:
        bic: ΔBIC must lie below: −6 is strong evidence (Kass & Raftery 1995, JASA 90, 773).
        p: p-value of such a gain, corrected for the effects tried, must lie below, …
        certain_bic: … unless ΔBIC lies below this, ten times what is called very strong: chance
            then cannot explain a gain that few blocks hold.
        t: paired t of the blocks' squared errors must exceed: chance does in 2.5 % of the cases.
        blocks: share of the touched blocks whose error must fall: otherwise one event carries the
            effect.
        held_out: the held-out error must fall below this share of before: smaller gains are seldom
            right and never matter. A shape must leave less of a name's to take its place.
        in_loop: the same for a log recorded in closed loop, where the input answers the
            disturbance, and wherever the errors are likely but not surely structured.
        own_part: share below which an effect must bring the error to keep a track, or to stay
            beside others: smaller changes depend on the seed of the noise.
        minor: an effect that significantly lowers the error below this share is mentioned.
        redundant: share of the gap below which a look-alike of an accepted effect is redundant.
        look_alike: a look-alike of an accepted effect that takes less than this share of the gap
            must take ``of_remainder`` of what is left; otherwise it corrects the other's law.
        of_remainder: a third effect that takes more than this share of what the others leave above
            the noise is not redundant, however small its share of the whole gap.
        touched: an effect touches a block when its predictions move by this share of the error.
        alike: runs that differ by less than this share of the remaining error are the same
            explanation.
        tie: models whose errors are within this factor cannot be distinguished, whatever the sample
            size; the simpler base is preferred up to it.
        known_tie: the same for effects that the catalogue lists as ties.
        chance_tie: the same where the paired t is below ``t``: the difference may be chance.
        least_gain, most_gain: factors within which the gain of the base must stay; small commands
            that hardly leave a dead zone make it far too small (a weight on the shaft leaves no
            gain at all, and has no upper factor).
    """

    bic: float = -6.0
    p: float = 0.05
    certain_bic: float = -60.0
    t: float = 2.0
    blocks: float = 0.5
    held_out: float = 0.90
    in_loop: float = 0.70
    own_part: float = 0.97
    redundant: float = 0.02
    look_alike: float = 0.10
    of_remainder: float = 0.5
    minor: float = 0.98
    touched: float = 0.02
    alike: float = 0.25
    tie: float = 1.02
    known_tie: float = 1.04
    chance_tie: float = 1.1
    least_gain: float = 1.0 / 3.0
    most_gain: float = 20.0


@dataclass(frozen=True)
class VerdictRule:
    """When errors ask for an explanation, and when the accepted effects are one.

    Attributes:
        structured_p: errors are structured when the p-value of the model-error model is below.
        certain_p: below this p-value something is missing, however small the predicted share.
        min_predicted_share: structure that predicts less of the errors beyond the noise is not a
            missing effect.
        residual_to_noise: errors beyond this multiple of the measurement noise are more than noise.
        residual_to_noise_later: the same once an effect is accepted.
        nearly_all: when less of the gap [%] is closed, the remainder is described.
        min_damping: a base with less damping swings on a spring; the catalogue has no spring law.
        min_share: an effect that would close less of the gap [%] is too small to matter, …
        residual_power_to_noise: … where the rest has less than this share of the noise's power.
        min_fit: a model with a lower free-run fit [%] on held-out data does not follow the log: its
            errors exceed 0.6 of the spread.
        min_fit_of_input: below this fit [%] an input explains nothing of an output whose
            measurements look like noise.
    """

    structured_p: float = 1e-3
    certain_p: float = 1e-6
    min_predicted_share: float = 0.15
    residual_to_noise: float = 1.5
    residual_to_noise_later: float = 1.1
    nearly_all: float = 90.0
    min_damping: float = 0.2
    min_share: float = 1.0
    residual_power_to_noise: float = 0.3
    min_fit: float = 40.0
    min_fit_of_input: float = 5.0


@dataclass(frozen=True)
class ShapeRule:
    """When a shape without physics is told, and when it takes the place of a name.

    Attributes:
        near: shapes whose scores differ by less are equal; the one with fewest numbers is told
            (10 in units of BIC is very strong evidence; Kass & Raftery 1995).
        numbers_of_law: at the place of a name a shape of so many numbers is as plain as a law: a
            size and a width, a size and a time.
        of_signals: a free curve of time follows anything slow, and another log needs another one:
            what depends on commands and outputs comes first while it explains this share of it.
        of_names: the same for a column that the log holds unused, which claims more.
        whole: a shape that explains less of the excess error is known in part: something else is
            missing that may have this shape for its shadow.
    """

    near: float = 10.0
    numbers_of_law: int = 2
    of_signals: float = 0.5
    of_names: float = 0.8
    whole: float = 0.8


@dataclass(frozen=True)
class PoseRule:
    """What is required of effects between tracks and ground beyond ``AcceptanceRule``.

    Attributes:
        min_slip: a smaller loss of distance is no slip even where the radius is given: a tyre rolls
            on less than its measured radius.
        min_growing_slip: a loss that grows with speed and stays below this at the highest speed is
            no slip: speeds that bend between samples, and their noise, explain it.
        min_lag_samples: a shorter lag [samples] is how the log was sampled: a speed counted over a
            sample is half a sample late.
        touched: an effect touches a window where it moves it by this share of the largest move.
        tie_std_errors: rivals whose squared errors differ by fewer standard errors are a tie, …
        same_gain: … or that gain this share of the likelihood: noise of the speeds, which enters
            the slip ratio, separates models that say the same of the vehicle.
        late_t, late_ratio: a second effect needs this t, and the held-out error below this share of
            before: most small late gains are chance.
        min_std_errors: standard errors that a parameter must be away from its null value.
        detectable_std_errors: an effect of so many standard errors would have been detected.
        residual_to_noise: increments off by this multiple of their noise are reported: speeds that
            change between samples can double it.
        min_predicted_share: share of the held-out error that distance, turn and heading must
            predict before something is called missing.
    """

    min_slip: float = 0.03
    min_growing_slip: float = 0.01
    min_lag_samples: float = 0.5
    touched: float = 1.0 / 3.0
    tie_std_errors: float = 2.0
    same_gain: float = 0.98
    late_t: float = 4.5
    late_ratio: float = 0.80
    min_std_errors: float = 3.0
    detectable_std_errors: float = 4.0
    residual_to_noise: float = 3.0
    min_predicted_share: float = 0.3


@dataclass(frozen=True)
class SearchBudget:
    """How much work the search for effects may do; logs of hidden effects set the parameters.

    Attributes:
        most_effects: effects of one model at most: five were never all proven.
        leaders: models that no log can tell apart from which the next effect is sought.
        shortlist: effects that are fitted in full.
        screened: effects that the screen hands on: of 47 blind logs from physics the truth was
            among the first nine in all but one.
        more_steps, full_steps: iterations of the best start of each law, and of the shortlist.
        polish: iterations of a model that is kept.
        coarse: gain of an iteration, as a share of the cost, at which candidates rest.
        leading: leading effects that are searched with most care where gradients say little.
        pairs: effects that are tried in pairs where none is accepted alone.
        law: a law of an effect is fitted in full while its cost is within this multiple of that of
            its best law.
        promising: a candidate is fitted in full when its first iterations bring some track's cost
            below this share.
        phases: phases of a wave that are tried on a record of its own: one in 15 degrees.
    """

    most_effects: int = 4
    leaders: int = 3
    shortlist: int = 9
    screened: int = 12
    more_steps: int = 4
    full_steps: int = 14
    polish: int = 30
    coarse: float = 1e-4
    leading: int = 4
    pairs: int = 3
    law: float = 1.5
    promising: float = 0.95
    phases: int = 24


ENDLESS = 1e100
"""A size beyond this belongs to a run without end; its square is still a number."""

RULE = AcceptanceRule()
VERDICT = VerdictRule()
SHAPES = ShapeRule()
POSE = PoseRule()
BUDGET = SearchBudget()
