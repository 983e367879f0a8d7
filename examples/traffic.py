"""Traffic: score forecasters on driving styles and roads, and draw a scene with its lanes.

    python traffic.py

Needs highway-env: pip install "motion-gym[highway]". Without `runs` and `seconds` a domain has its full size.
"""

import motion_gym

SMALL = {"runs": 1, "seconds": 16.0}


def main() -> None:
    """Score two forecasters, count vehicles, and write roundabout.png."""
    for scenario, style in (("straight", "calm"), ("straight", "aggressive"), ("roundabout", "normal")):
        domain = motion_gym.domain("highway", scenario=scenario, style=style, **SMALL)
        scores = []
        for predictor in ("constant_velocity", "constant_acceleration"):
            card = motion_gym.evaluate(predictor, domain)
            scores.append(f"{predictor} ADE {card.metrics['ADE'].mean:.2f} m")
        counts = domain.card.counts["test"]
        print(
            f"{scenario}, {style}: {', '.join(scores)}; {counts['agents']} vehicles, "
            f"{counts['crashed_agents']} crashed and left out"
        )
    motion_gym.show(domain, ["constant_velocity", "idm_oracle"], out="roundabout.png")
    print("Written: roundabout.png")


if __name__ == "__main__":
    main()
