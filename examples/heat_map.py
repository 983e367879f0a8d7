"""Draw where `heatmap` expects a person to be after 4.8 s, on the image of a drone video.

Needs the Stanford Drone Dataset and weights trained on it (no commercial use):
motion-gym data add sdd --from DIR; motion-gym weights add --from DIR
"""

import numpy as np

import motion_gym
from motion_gym.data.windows import pick_scenes

SPEC, SCENE = "sdd:speed=3.25-3.75,image=true,background=labels", 40
domain = motion_gym.domain(SPEC)
truth = pick_scenes(domain.windows("test"), [SCENE])
predictor = motion_gym.predictor("heatmap:weights=sdd")

figure = motion_gym.show(SPEC.replace("labels", "photo"), ["heatmap:weights=sdd", "linear"], scene=SCENE, k=20)
axes = figure.axes[0]
(left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
maps, crops = predictor.goal_maps(truth.observation)
centers = (np.arange(maps.shape[1]) + 0.5) * 2 / maps.shape[1] - 1
places = crops.outside(np.stack(np.meshgrid(centers, centers), axis=-1).reshape(1, -1, 2))
for probabilities, positions in zip(maps, places.reshape(*maps.shape, 2), strict=True):
    levels = np.array([0.02, 0.1, 0.3, 0.6, 1]) * probabilities.max()
    axes.contourf(*positions.transpose(2, 0, 1), probabilities, levels, cmap="magma", alpha=0.6, zorder=0.5)
    likely = positions[probabilities > levels[0]]
    left, right = min(left, likely[:, 0].min()), max(right, likely[:, 0].max())
    low, high = max(low, likely[:, 1].max()), min(high, likely[:, 1].min())  # y points downwards
axes.set(xlim=(left, right), ylim=(low, high))
figure.savefig("heat_map.png", dpi=120)
print("Written: heat_map.png")
