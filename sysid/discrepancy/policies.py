"""The numbers that decide what is named and how long it is looked for, each with its reason."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AcceptanceRule:
    """When an effect belongs to a model: the rule that held on real records, where AIC did not.

    Attributes:
        bic: ΔBIC must lie below: −6 is strong evidence (Kass & Raftery 1995, JASA 90, 773).
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
    """

    bic: float = -6.0
    t: float = 2.0
    blocks: float = 0.5
    held_out: float = 0.90
    in_loop: float = 0.70
    own_part: float = 0.97
    minor: float = 0.98


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
    promising: float = 0.95
    phases: int = 24


RULE = AcceptanceRule()
BUDGET = SearchBudget()
