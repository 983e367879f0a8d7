"""The results page: one file with the leaderboard, tables, curves, claims and a scene player."""
