"""The numbers that decide what is named and how long it is looked for, each with its reason."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AcceptanceRule:
    """When an effect belongs to a model: the rule that held on real records, where AIC did not.

    Attributes:
        bic: ΔBIC must lie below: −6 is strong evidence (Kass & Raftery 1995, JASA 90, 773).
        p: chance of such a gain, corrected for the effects tried, must lie below, …
        certain_bic: … unless ΔBIC lies below this, ten times what is called very strong: then few
            blocks that hold much of the gain make no chance of it.
        t: paired t of the blocks' squared errors must exceed: chance does in 2.5 % of the cases.
        blocks: share of the touched blocks whose error must fall: most of them, else one event
            carries the effect.
        held_out: the held-out error must fall below this share of before: an effect that takes less
            than a tenth is seldom right and never matters.
        in_loop: the same for a log recorded in closed loop, where the input answers the
            disturbance, and wherever structure of the errors is likely but not sure.
        own_part: an error must fall below this share for a track, or one effect of several, to keep
            its part: less moves with the seed of the noise.
        minor: an effect that significantly lowers the error below this share is mentioned.
        mends: share of the gap below which a look-alike only mends the formula of another, and an
            effect is not worth more than one whose law is a case of its own.
        look_alike: a look-alike of a named effect that takes less than this share of the gap has to
            take ``of_rest`` of what is left: else it takes a share of what the law misses.
        of_rest: a third effect that takes more than this share of what the others leave above the
            noise mends no formula, however small a part of the whole gap that is.
        unrivalled: an effect whose score is so many times that of any other beside the same model,
            and beyond chance above it, is no stand-in, however little it takes: what stands in for
            another has rivals. One that others wait for need not meet ``in_loop`` then.
        touched: a block counts as touched by an effect when its predictions move by this share of
            the error.
        alike: runs that differ by less than this share of the error that is left are the same
            explanation.
        tie: models whose errors are within this factor cannot be told apart, whatever the sample
            size.
        known_tie: the same for effects that the catalogue knows to be alike.
        chance_tie: the same where the paired t is below ``t``, too: the difference may be chance.
        least_gain, most_gain: a base does not absorb so much that its gain were smaller or larger
            by more than these factors; small commands that hardly leave a dead zone make it far
            too small.
        as_good: fewer effects on a plainer base are preferred up to this ratio of held-out errors.
    """

    bic: float = -6.0
    p: float = 0.05
    certain_bic: float = -60.0
    t: float = 2.0
    blocks: float = 0.5
    held_out: float = 0.90
    in_loop: float = 0.70
    own_part: float = 0.97
    minor: float = 0.98
    mends: float = 0.02
    look_alike: float = 0.10
    of_rest: float = 0.5
    unrivalled: float = 2.0
    touched: float = 0.02
    alike: float = 0.25
    tie: float = 1.02
    known_tie: float = 1.04
    chance_tie: float = 1.1
    least_gain: float = 1.0 / 3.0
    most_gain: float = 20.0
    as_good: float = 1.02


@dataclass(frozen=True)
class VerdictRule:
    """When errors ask for an explanation, and when what was named is one.

    Attributes:
        dependent: errors are structured when the p-value of the model-error model is below.
        likely: loud errors are worth a search when it is below.
        certain: structure as sure as this misses something, however little of it is foretold.
        slight: structure that holds less of the errors beyond the noise is no missing effect.
        loud: errors beyond this multiple of the noise of the readings are more than noise.
        audible: the same beside an effect that is named already.
        below: errors of a model below this share of the noise refute what was taken for noise.
        nearly_all: less of the gap [%] closed, and what remains is described.
        swings: a base with less damping is held by a spring; the catalogue has no law of one.
        alone: an effect that stands alone and closes less of what is missing [%] while the rest
            keeps its structure is a share of something else.
        minor: an effect that would close less of the gap [%] is too small to matter, …
        quiet: … where what is left has less than this share of the power of the noise.
        follows: a model with a lower free-run fit on held-out data [%] follows nothing: its errors
            exceed 0.6 of the spread and tell nothing.
        explains: below this fit [%] an input explains nothing of an output whose readings look
            like noise.
    """

    dependent: float = 1e-3
    likely: float = 0.05
    certain: float = 1e-6
    slight: float = 0.15
    loud: float = 1.5
    audible: float = 1.1
    below: float = 0.8
    nearly_all: float = 90.0
    swings: float = 0.2
    alone: float = 25.0
    minor: float = 1.0
    quiet: float = 0.3
    follows: float = 40.0
    explains: float = 5.0


@dataclass(frozen=True)
class PoseRule:
    """What more is asked of effects between tracks and ground.

    Attributes:
        most_effects: as many at most; a pair of radii counts as two.
        rolled: a share of the way lost below this is no slip although the radius is given: what a
            wheel rolls on is less than what a ruler says by so much, as tyres sit lower.
        lost: a share of the way that grows with the speed and stays below this at the highest one
            is no slip: it is what speeds that bend between samples, and their noise, leave open.
        between: a lag below this share of a sample is how the log was sampled: a speed taken from
            counts of a sample comes half of one late.
        touched: a window counts as touched where an effect moves it by this share of the most.
        tied: rivals whose squared errors differ by fewer standard errors are a tie, …
        same_gain: … or that gain this share of the likelihood: noise of the speeds, which enters
            the share of slip, sets models apart that say the same of the vehicle.
        late_t, late_ratio: a second effect needs this t, and the held-out error below this share of
            before: most small late gains are chance.
        away: the number of an effect must be so many standard errors away from doing nothing.
        shown: an effect of so many standard errors would have been seen.
        loud: increments off by this multiple of their noise are told: speeds that change between
            samples alone can double it.
        structured: share of the held-out error that way, turn and heading must foretell to be
            something missing.
    """

    most_effects: int = 4
    rolled: float = 0.03
    lost: float = 0.01
    between: float = 0.5
    touched: float = 1.0 / 3.0
    tied: float = 2.0
    same_gain: float = 0.98
    late_t: float = 4.5
    late_ratio: float = 0.80
    away: float = 3.0
    shown: float = 4.0
    loud: float = 3.0
    structured: float = 0.3


@dataclass(frozen=True)
class SearchBudget:
    """How much work the search for effects may do; logs of hidden effects set the numbers.

    Attributes:
        most_effects: effects of one model at most: five were never all proven.
        beam: sets that are grown side by side: the likeliest first effect may be a stand-in.
        far_ahead: a rival is not grown when the leader's set scores so many times higher.
        shortlist: effects that are fitted in full.
        first_steps, more_steps, full_steps: steps of all starts, of the best start of each effect,
            and of the shortlist.
        polish: steps of a model that is kept.
        coarse: gain of a step, as a share of the cost, at which candidates rest.
        leading: effects that lead so far are searched with most care where slopes say little.
        law: a law of an effect is fitted in full while its cost is within this multiple of that of
            its best one.
        promising: a candidate is fitted in full when its first steps bring some track's cost below
            this share.
        phases: phases of a wave that are tried on a record of its own: one in 15 degrees.
    """

    most_effects: int = 4
    beam: int = 2
    far_ahead: float = 4.0
    shortlist: int = 9
    first_steps: int = 2
    more_steps: int = 4
    full_steps: int = 14
    polish: int = 30
    coarse: float = 1e-4
    leading: int = 4
    law: float = 1.5
    promising: float = 0.95
    phases: int = 24


RULE = AcceptanceRule()
VERDICT = VerdictRule()
POSE = PoseRule()
BUDGET = SearchBudget()
