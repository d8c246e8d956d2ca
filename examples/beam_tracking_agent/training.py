"""Train the agent with Stable-Baselines3."""

from collections.abc import Sequence

import numpy as np

from examples.beam_tracking_agent.drives import Drive, Replay
from examples.beam_tracking_agent.methods import follow
from mmw.core.extras import needed_by

with needed_by("examples.beam_tracking_agent"):
    import torch
    from stable_baselines3 import DQN
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.utils import LinearSchedule

ENVIRONMENTS = 16
"""Environments that are stepped together."""

EPISODE = 50
"""Steps of an episode of training."""


def train(
    train_drives: Sequence[Drive], test: Sequence[Sequence[Drive]], *, steps: int, looks: int, seed: int
) -> tuple[np.ndarray, np.ndarray, DQN]:
    """Train a deep Q-network (DQN), and look several times at how it does in drives that it has not seen.

    Beams do not change what happens to a vehicle, so the discount factor is 0: the value of a beam is the reward that
    is expected of it in the next step.

    Args:
        train_drives: Drives of the training.
        test: Drives of each test seed.
        steps: Steps of a vehicle in all.
        looks: Evaluations, evenly spaced; one before the training comes first.
        seed: Seed of weights, exploration and episodes.

    Returns:
        Steps of the evaluations [looks + 1]; mean spectral efficiency [bit/s/Hz] of each in each test seed
        [looks + 1, seeds]; the agent.
    """
    torch.set_num_threads(1)  # threads that wait for each other take longer than these small products
    length = min(EPISODE, min(len(drive.rates) for drive in train_drives) - 1)
    env = make_vec_env(lambda: Replay(train_drives, length), n_envs=ENVIRONMENTS, seed=seed)
    agent = DQN(
        "MlpPolicy",
        env,
        learning_rate=LinearSchedule(1e-3, 0.0, 1.0),
        buffer_size=steps,
        learning_starts=min(1000, steps // 4),
        batch_size=128,
        gamma=0.0,
        train_freq=1,
        gradient_steps=4,
        exploration_fraction=0.3,
        exploration_final_eps=0.05,
        policy_kwargs={"net_arch": [256, 256]},
        seed=seed,
        device="cpu",
    )
    taken, scores = [], []

    def look() -> None:
        taken.append(agent.num_timesteps)
        scores.append(follow(lambda seen: agent.predict(seen, deterministic=True)[0], test))

    def after_step(*_: object) -> bool:
        if agent.num_timesteps * looks >= len(taken) * steps:
            look()
        return True

    look()
    agent.learn(steps, callback=after_step)
    env.close()
    return np.array(taken), np.array(scores), agent
