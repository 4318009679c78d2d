"""Learners: thin layers over Stable-Baselines3 and imitation (extra ``train``)."""
