"""Estimators against scenarios: run, store, statistics, leaderboard."""
