"""The sentences about results that the documentation makes, and the tests that decide them.

A sentence that does not hold is followed by the sentence that replaces it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from motion_gym.benchmarks.claims import NOT_EVERYWHERE, NOWHERE, Claim

ANY = float("inf")
ALPHAS = ("1", "2", "4", "8", "16", "32", "64")
PENALTIES = ("invariant:penalty=1", "invariant:penalty=3", "invariant")
RELATIVE = ("linear:sigma=relative", "erm:sigma=relative")
FEATURE_ROWS = ("linear:sigma=true", "erm", "counterfactual", *PENALTIES, "vrex", "group_dro")
PLACES = ("hotel", "univ", "zara1", "zara2")
ORIGINAL = ("erm_no_sigma", "counterfactual:sigma=false", "invariant:sigma=false,penalty=0.125")
NETWORKS = ("style_erm", "style_invariant", "modular", "modular_invariant")
OUT = ("0.4", "0.6", "0.7", "0.8")
"""Styles d that were not trained with."""
TUNED_LESS = ("transfer:parts=all", "transfer:parts=modulator", "transfer:parts=last_layer")
WEIGHTS_ADAPTED = (
    *(f"finetune:parts={parts}" for parts in ("all", "style", "modulator", "last_layer")),
    "ema_anchor:parts=all",
    "kalman",
    "ekf:parts=modulator",
)
FILTERS = ("kalman", "ekf:parts=modulator")
OTHER_ADAPTERS = ("style", "refine", *WEIGHTS_ADAPTED[:5])

_SPURIOUS = (
    Claim(
        "erm and counterfactual are level up to alpha 8 (within 15 % of the ADE at 8)",
        ["erm", "counterfactual"],
        columns=ALPHAS[:3],
        panel="0",
        than_column="8",
        ratio=(0.85, 1.15),
        significant=False,
    ),
    Claim(
        "erm, counterfactual, vrex and group_dro break after alpha 8",
        ["erm", "counterfactual", "vrex", "group_dro"],
        columns=ALPHAS[4:],
        panel="0",
        than_column="8",
        ratio=(1.5, ANY),
    ),
    Claim(
        "The invariance penalty breaks later than alpha 16",
        PENALTIES,
        columns=["16"],
        panel="0",
        than_column="8",
        ratio=(0.85, 1.15),
        significant=False,
    ),
    Claim(
        "At alpha 16 the error of the penalty rows is 20 to 35 % above that at alpha 8",
        PENALTIES,
        columns=["16"],
        panel="0",
        than_column="8",
        ratio=(1.2, 1.35),
        significant=False,
    ),
    Claim("The invariance penalty breaks less (lower ADE at alpha 64)", PENALTIES, ["erm"], ["64"], panel="0"),
    Claim("The penalty with lambda 1 has a lower ADE than erm at alpha 16", PENALTIES[:1], ["erm"], ["16"], panel="0"),
    Claim("The penalty costs some error at the alphas of training", ["erm"], PENALTIES, ALPHAS[:4], panel="0"),
    Claim(
        "With lambda 3 and 5 the penalty costs error at the alphas of training, with lambda 1 at alpha 8",
        ["erm"],
        PENALTIES[1:],
        ALPHAS[:4],
        panel="0",
    ),
    Claim(
        "With lambda 1 the curve is the paper's (JADE_20 within 20 % at each alpha)",
        PENALTIES[:1],
        ["the paper: invariant:penalty=1"],
        panel="published",
        columns=("1", "8", "16", "32", "64"),
        ratio=(0.8, 1.2),
        significant=False,
    ),
    Claim(
        "With lambda 3 the error rises earlier than the paper's (15 % or more above it from alpha 16 on)",
        PENALTIES[1:2],
        ["the paper: invariant:penalty=3"],
        panel="published",
        columns=("16", "32", "64"),
        ratio=(1.15, ANY),
        significant=False,
    ),
    Claim(
        "With lambda 5 the error rises earlier than the paper's (15 % or more above it from alpha 16 on)",
        PENALTIES[2:],
        ["the paper: invariant"],
        panel="published",
        columns=("16", "32", "64"),
        ratio=(1.15, ANY),
        significant=False,
    ),
    Claim(
        "Training for a quarter of the paper's epochs causes the earlier rise with lambda 3 and 5",
        ["invariant, trained for 800 epochs"],
        ["invariant"],
        panel="0",
    ),
    Claim(
        "The rows with sigma=relative are the best at every alpha",
        RELATIVE,
        FEATURE_ROWS,
        ALPHAS,
        panel="0",
        significant=False,
    ),
    Claim(
        "linear:sigma=relative has the lowest ADE at every alpha",
        RELATIVE[:1],
        ("erm:sigma=relative", *FEATURE_ROWS, "erm_no_sigma", "linear", "constant_velocity"),
        ALPHAS,
        panel="0",
        significant=False,
    ),
    Claim(
        "With sigma from the past, the penalty raises the error at alpha 8", ["erm"], ["invariant"], ["8"], panel="1"
    ),
    Claim(
        "The counterfactual decoder is worse than erm at alpha 64, and better in the paper",
        ["erm"],
        ["counterfactual"],
        ["64"],
        panel="0",
        significant=False,
    ),
)
_ORIGINAL = (
    Claim(
        "Everywhere but at eth constant velocity is better than all networks",
        ["constant_velocity"],
        ORIGINAL,
        PLACES,
    ),
    Claim(
        "Everywhere but at eth constant velocity has a lower mean error than all networks",
        ["constant_velocity"],
        ORIGINAL,
        PLACES,
        significant=False,
    ),
    Claim(
        "At hotel plain training comes close to the paper's number (within 10 %)",
        ORIGINAL[:1],
        ["the paper: erm_no_sigma"],
        ["hotel"],
        panel="published",
        ratio=(0.9, 1.1),
        significant=False,
    ),
    Claim(
        "At hotel neither the counterfactual decoder nor the penalty does better than plain training",
        ORIGINAL[1:],
        ORIGINAL[:1],
        ["hotel"],
        where=NOWHERE,
    ),
)
_STYLE = (
    Claim("A style lowers the mean error everywhere", ["modular"], ["style_erm"], panel="0", significant=False),
    Claim(
        "In each agent's own frame, a style lowers the mean error everywhere but at d = 0.3 of the blind circle",
        ["ego_modular"],
        ["ego_erm"],
        where=NOT_EVERYWHERE,
        significant=False,
    ),
    Claim(
        "In each agent's own frame, a style lowers the mean error at every d of the usual circle",
        ["ego_modular"],
        ["ego_erm"],
        panel="0",
        significant=False,
    ),
    Claim(
        "Without reference scenes, modular is no better than style_erm out of distribution",
        ["modular"],
        ["style_erm"],
        ("0.4, 0 references", "0.6, 0 references"),
        panel="references",
        where=NOWHERE,
    ),
    Claim(
        "Without reference scenes, modular is no better than style_erm at d = 0.6, but better at d = 0.4",
        ["modular"],
        ["style_erm"],
        ("0.4, 0 references", "0.6, 0 references"),
        panel="references",
        where=NOT_EVERYWHERE,
    ),
    Claim(
        "A handful of reference scenes is enough: modular with 4 is within 5 % of modular with 256, at d = 0.6",
        ["modular"],
        columns=["0.6, 4 references"],
        panel="references",
        than_column="0.6, 256 references",
        ratio=(0.0, 1.05),
        significant=False,
    ),
    Claim(
        "modular_invariant is not better than modular out of distribution",
        ["modular_invariant"],
        ["modular"],
        OUT,
        panel="0",
        where=NOWHERE,
    ),
    Claim(
        "ego_erm, without any style, has less than half of the error of every network of the paper",
        ["ego_erm"],
        NETWORKS,
        panel="0",
        ratio=(0.0, 0.5),
    ),
    Claim(
        "ego_erm, without any style, has less than half of the mean error of every network of the paper",
        ["ego_erm"],
        NETWORKS,
        panel="0",
        ratio=(0.0, 0.5),
        significant=False,
    ),
    Claim(
        "The frame matters more than the style",
        ["style_erm, in each agent's own frame"],
        ["modular"],
        panel="0",
    ),
    Claim(
        "On the blind circle only ego_modular can know the style", ["ego_modular"], ["modular", "ego_erm"], panel="2"
    ),
    Claim(
        "On the blind circle ego_modular is better than ego_erm out of distribution; modular was not scored there",
        ["ego_modular"],
        ["ego_erm"],
        OUT,
        panel="2",
    ),
)
_CROWD = (
    Claim(
        "With a style the mean error of STGAT is 8 to 11 % lower",
        ["modular_stgat"],
        ["erm_no_sigma"],
        ratio=(0.89, 0.92),
        significant=False,
    ),
    Claim(
        "With a style the error of STGAT is lower in all seeds up to d = 0.7",
        ["modular_stgat"],
        ["erm_no_sigma"],
        ("0.1", "0.3", "0.4", "0.5", "0.6", "0.7"),
        each_seed=True,
        significant=False,
    ),
    Claim(
        "With a style the error of STGAT is significantly lower at d = 0.4, 0.5 and 0.6",
        ["modular_stgat"],
        ["erm_no_sigma"],
        ("0.4", "0.5", "0.6"),
    ),
    Claim(
        "STGAT, with and without a style, has less than half of the error of constant velocity from d = 0.3 on",
        ["modular_stgat", "erm_no_sigma"],
        ["constant_velocity"],
        ("0.3", "0.4", "0.5", "0.6", "0.7", "0.8"),
        ratio=(0.0, 0.5),
    ),
)
_TRANSFER = (
    Claim(
        "Looking at one batch is most of the gain",
        ["modular_invariant"],
        columns=["1"],
        panel="0",
        than_column="0",
        ratio=(0.0, 0.6),
    ),
    Claim(
        "Tuning lowers the error below reading the style from the second batch on",
        ["transfer:parts=style"],
        ["modular_invariant"],
        ("2", "3", "4", "5", "6"),
        panel="0",
    ),
    Claim(
        "Tuning psi, f and g lowers the mean error below reading the style from the second batch on",
        ["transfer:parts=style"],
        ["modular_invariant"],
        ("2", "3", "4", "5", "6"),
        panel="0",
        significant=False,
    ),
    Claim(
        "Tuning psi, f and g together has the lowest mean error from the second batch on",
        ["transfer:parts=style"],
        TUNED_LESS,
        ("2", "3", "4", "5", "6"),
        panel="0",
        significant=False,
    ),
    Claim(
        "Tuning f alone is not better than tuning everything at one and two batches",
        ["transfer:parts=modulator"],
        ["transfer:parts=all"],
        ("1", "2"),
        panel="0",
        where=NOWHERE,
    ),
    Claim(
        "By the published protocol tuning f alone is better than tuning the whole network at one batch",
        ["transfer:parts=modulator"],
        ["transfer:parts=all"],
        ["1"],
        panel="1",
    ),
    Claim(
        "By the published protocol tuning f alone is better at one batch than psi, f and g, the paper's everything",
        ["transfer:parts=modulator"],
        ["transfer:parts=style"],
        ["1"],
        panel="1",
    ),
    Claim(
        "By the published protocol tuning f alone has the lowest mean error of what is tuned at one batch",
        ["transfer:parts=modulator"],
        ["transfer:parts=all", "transfer:parts=style", "transfer:parts=last_layer"],
        ["1"],
        panel="1",
        significant=False,
    ),
    Claim("Refinement lowers the error after tuning, each time", ["refine:of=transfer"], TUNED_LESS[1:2], panel="0"),
    Claim(
        "Refinement lowers the error after tuning by the published protocol, each time",
        ["refine:of=transfer"],
        TUNED_LESS[1:2],
        panel="1",
    ),
    Claim(
        "Refinement lowers the mean error after tuning at every number of batches, not significantly at each",
        ["refine:of=transfer"],
        TUNED_LESS[1:2],
        panel="0",
        significant=False,
    ),
)
_REFINEMENT = (
    Claim(
        "Refinement by 3 steps lowers the mean error of modular_invariant at every d",
        ["refine"],
        ["modular_invariant"],
        panel="0",
        significant=False,
    ),
    Claim(
        "Refinement by 3 steps lowers the mean error of modular at every d",
        ["refine:of=modular"],
        ["modular"],
        panel="0",
        significant=False,
    ),
)
_ONLINE = (
    Claim(
        "Where the style changes suddenly, the filters gain most", FILTERS, OTHER_ADAPTERS, ["sudden"], panel="style"
    ),
    Claim(
        "Where the style changes suddenly, the filters have the lowest mean ADE after the shift",
        FILTERS,
        OTHER_ADAPTERS,
        ["sudden"],
        panel="style",
        significant=False,
    ),
    Claim(
        "The filters are within 10 % of the oracle after 90 matured forecasts, in all five runs",
        FILTERS,
        ["oracle"],
        ["from 90 on"],
        panel="style",
        ratio=(0.0, 1.1),
        significant=False,
        each_seed=True,
    ),
    Claim(
        "After 90 matured forecasts the mean ADE of the filters is 15 to 40 % above the oracle's",
        FILTERS,
        ["oracle"],
        ["from 90 on"],
        panel="style",
        ratio=(1.15, 1.4),
        significant=False,
    ),
    Claim(
        "Tuning the modulator alone is not better than tuning everything after a sudden change of style",
        ["finetune:parts=modulator"],
        ["finetune:parts=all"],
        ["sudden"],
        panel="style",
        where=NOWHERE,
    ),
    Claim(
        "When d = 0.3 comes back, the error has grown by 11 to 32 % where weights were adapted",
        WEIGHTS_ADAPTED,
        ["none"],
        ["on return"],
        panel="style",
        ratio=(1.11, 1.32),
        significant=False,
    ),
    Claim(
        "When d = 0.3 comes back, the error has grown by 77 % or more where the style is read from the last scenes",
        ["style", "refine"],
        ["none"],
        ["on return"],
        panel="style",
        ratio=(1.77, ANY),
        significant=False,
    ),
    Claim(
        "When d = 0.3 comes back, the error of hedge has grown by 5 %",
        ["hedge"],
        ["none"],
        ["on return"],
        panel="style",
        ratio=(1.04, 1.06),
        significant=False,
    ),
    Claim(
        "Under another noise, kalman and tuning everything take a third or more off the error of the source model",
        ["kalman", "finetune:parts=all,every=4"],
        ["none"],
        panel="alpha",
        ratio=(0.0, 0.67),
        significant=False,
    ),
    Claim(
        "Under another noise, kalman and tuning everything take 30 % or more off after a sudden shift",
        ["kalman", "finetune:parts=all,every=4"],
        ["none"],
        ["sudden"],
        panel="alpha",
        ratio=(0.0, 0.7),
    ),
    Claim(
        "Under another noise, kalman and tuning everything stay above constant velocity after a sudden shift",
        ["constant_velocity"],
        ["kalman", "finetune:parts=all,every=4"],
        ["sudden"],
        panel="alpha",
    ),
    Claim(
        "After a sudden change of noise hedge is within 1 % of constant velocity",
        ["hedge"],
        ["constant_velocity"],
        ["sudden"],
        panel="alpha",
        ratio=(0.99, 1.01),
        significant=False,
        each_seed=True,
    ),
    Claim(
        "After a sudden change of noise hedge is within 6 % of constant velocity for each seed",
        ["hedge"],
        ["constant_velocity"],
        ["sudden"],
        panel="alpha",
        ratio=(0.94, 1.06),
        significant=False,
        each_seed=True,
    ),
    Claim(
        "From the 150th matured forecast on, hedge is below constant velocity",
        ["hedge"],
        ["constant_velocity"],
        [f"last 50 at {n}" for n in (150, 200, 250, 300)],
        panel="alpha",
        significant=False,
    ),
    Claim(
        "At other places constant velocity is better than the oracle",
        ["constant_velocity"],
        ["oracle"],
        ["sudden"],
        panel="places",
        significant=False,
    ),
    Claim(
        "At other places kalman is worse than the source model right after the shift (2.21 against 0.61)",
        ["none"],
        ["kalman"],
        ["last 50 at 50"],
        panel="places",
    ),
)

CLAIMS: Mapping[str, Sequence[Claim]] = {
    "spurious": _SPURIOUS,
    "original": _ORIGINAL,
    "style": _STYLE,
    "crowd": _CROWD,
    "transfer": _TRANSFER,
    "refinement": _REFINEMENT,
    "online": _ONLINE,
}
"""Claims by benchmark, besides those that stand in the tables of the benchmark."""
