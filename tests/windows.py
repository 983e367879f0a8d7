"""Windows of recordings, as a domain would cut them."""

from motion_gym.data.windows import Tracks, cut_windows, positions_only


def windows_of(recordings, features=positions_only, min_agents=1, stride=1):
    return cut_windows([Tracks.of(recording) for recording in recordings], features, min_agents, stride)
