"""Forecast people of one speed after fitting to other speeds, on drone video, and draw a scene on its image.

Needs the Stanford Drone Dataset (no commercial use): motion-gym data add sdd --from DIR
"""

import motion_gym

target = "sdd:speed=3.25-3.75"
print("fitted to:", ", ".join(source.speed for source in motion_gym.domain(target).sources()))
for unit in ("px", "m"):  # metres are estimates, one scale for each clip
    for predictor in ("constant_velocity", "linear"):
        score = motion_gym.evaluate(predictor, f"{target},unit={unit}")
        print(f"{predictor:18} ADE {score.ade.mean:.3g} {unit}, FDE {score.fde.mean:.3g} {unit}")

# What a predictor may see of the ground: the label map, in the frame of the positions.
observation = motion_gym.domain(f"{target},image=true,background=labels").windows("test").observation
image = observation.images[0]
column, row = ((observation.xy[0, -1] - image.corner) / image.pixel).astype(int)
print(f"the first agent stands on ground of class {image.labels[row, column]}")

motion_gym.show(target, ["constant_velocity", "linear"], scene=40, out="drone.png")
print("Written: drone.png")
