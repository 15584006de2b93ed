"""Networks behind an image bank, operation counts, and the controls without attention."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from corridor import CELLS, Corridor
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.torch_layers import NatureCNN
from stable_baselines3.common.vec_env import DummyVecEnv
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from attn_tree.tree.node import Tree
from attn_tree.vision.retina import Retina, meter
from baselines.bank_extractor import BankExtractor
from baselines.glimpse import GlimpsePPO
from baselines.macs import count_macs
from baselines.nature_cnn import NatureDQN, NatureExtractor, NaturePPO
from baselines.pixel_tree import PixelTree, Threshold, ThresholdVocabulary
from baselines.random_agent import RandomAgent
from baselines.tabular import TabularQ, ThumbnailQ

BANK = Corridor().bank


def vec(n: int = 4, obs: str = "index") -> DummyVecEnv:
    return DummyVecEnv([lambda: Corridor(obs)] * n)


def one_hot(indices: list[int]) -> torch.Tensor:
    return nn.functional.one_hot(torch.tensor(indices), CELLS).float()


# Bank ------------------------------------------------------------------------------


def test_bank_extractor_is_its_extractor_on_the_images() -> None:
    bank = BankExtractor(spaces.Discrete(CELLS), BANK, NatureExtractor)
    order = [3, 1, 3, 0]
    images = torch.tensor(BANK[order]).permute(0, 3, 1, 2).float() / 255
    expected = bank.extractor(images)
    assert expected.std() > 0
    torch.testing.assert_close(bank(one_hot(order)), expected)
    torch.testing.assert_close(bank(one_hot(order)[:, None]), expected)  # SB3's buffers add an axis
    with meter() as cost:  # repeated images are computed, and counted, again
        torch.testing.assert_close(bank(one_hot(order)), expected)
    assert cost.recognition == len(order) * 40 * 40


def test_bank_extractor_has_the_gradient_of_every_occurrence() -> None:
    bank = BankExtractor(spaces.Discrete(CELLS), BANK, NatureExtractor)
    gradients = []
    for times in (1, 3):
        bank.zero_grad()
        bank(one_hot([2] * times)).sum().backward()
        gradients.append(bank.extractor.linear[0].weight.grad.clone())
    torch.testing.assert_close(gradients[1], 3 * gradients[0])


def test_bank_is_exchanged_not_saved() -> None:
    bank = BankExtractor(spaces.Discrete(CELLS), BANK, NatureExtractor)
    assert not any("_bank" in name for name in bank.state_dict())
    before = bank(one_hot([1]))
    bank.set_bank(BANK[::-1][:4])
    torch.testing.assert_close(bank(one_hot([3])), before)
    with pytest.raises(ValueError, match="cannot name 6 images"):
        bank.set_bank(np.zeros((6, 40, 40, 3), np.uint8))
    with pytest.raises(ValueError, match=r"reads images of \(C, H, W\) = \(3, 40, 40\)"):
        bank.set_bank(np.zeros((2, 36, 40, 3), np.uint8))
    with pytest.raises(ValueError, match="as many images, not 4"):
        BankExtractor(spaces.Discrete(CELLS), BANK[:4], NatureExtractor)


def test_environment_without_bank_or_images_is_refused() -> None:
    for env_id, word in (("FrozenLake-v1", "attribute `bank`"), ("CartPole-v1", "uint8 images")):
        for build in (NaturePPO, NatureDQN, GlimpsePPO):
            with pytest.raises(ValueError, match=word):
                build(env_id)


# NatureCNN -------------------------------------------------------------------------


def test_nature_network_is_sb3s_in_either_channel_order() -> None:
    """With the same weights; on Corridor pixels SB3 puts the channels first."""
    stock = NatureCNN(spaces.Box(0, 255, (3, 40, 40), np.uint8))
    images = torch.rand(2, 3, 40, 40)
    for shape, seen in (((3, 40, 40), images), ((40, 40, 3), images.permute(0, 2, 3, 1))):
        ours = NatureExtractor(spaces.Box(0, 255, shape, np.uint8))
        ours.load_state_dict(stock.state_dict())
        torch.testing.assert_close(ours(seen), stock(images))


def test_nature_ppo_index_and_pixels_learn_the_same() -> None:
    policies = []
    for obs in ("index", "pixels"):
        model = NaturePPO(vec(obs=obs), seed=1, n_steps=16, batch_size=64).learn(128)
        seen = np.arange(CELLS) if obs == "index" else BANK
        observations, _ = model.policy.obs_to_tensor(seen)
        policies.append(model.policy.get_distribution(observations).distribution.probs.detach().numpy())
    assert policies[0] == pytest.approx(policies[1], abs=1e-3)


def test_full_image_costs_every_pixel_and_a_binned_one_its_values() -> None:
    for size, values in ((None, 1600), (36, 1296)):
        model = NaturePPO(vec(1), size=size, seed=0)
        with meter() as cost:
            model.predict(np.array([2]))
        assert (cost.selection, cost.recognition) == (0, values)


def test_dqn_learns_the_corridor() -> None:
    model = NatureDQN(vec(), seed=0).learn(1500)
    actions, _ = model.predict(np.arange(CELLS - 1), deterministic=True)
    assert actions.tolist() == [1] * (CELLS - 1)


def test_models_are_stock_and_survive_saving(tmp_path: Path) -> None:
    model = GlimpsePPO(vec(), seed=0, policy_kwargs={"net_arch": [16]})
    assert type(model) is PPO
    model.save(tmp_path / "m")
    again = PPO.load(tmp_path / "m")
    assert [p.out_features for p in again.policy.mlp_extractor.policy_net if hasattr(p, "out_features")] == [
        16
    ]
    for seen in range(CELLS):
        assert model.predict(seen, deterministic=True)[0] == again.predict(seen, deterministic=True)[0]


# Operations ------------------------------------------------------------------------


def test_macs_are_half_of_torchs_flops() -> None:
    for build in (NaturePPO, GlimpsePPO):
        model = build(vec(1), seed=0)
        with count_macs(model.policy) as work, FlopCounterMode(display=False) as oracle:
            model.predict(np.array([0]), deterministic=True)
        assert work.macs == oracle.get_total_flops() // 2 > 0
    assert not any(module._forward_hooks for module in model.policy.modules())


def test_macs_of_a_recurrent_layer_by_hand() -> None:
    with count_macs(gru := nn.GRU(5, 7, batch_first=True)) as work:
        gru(torch.zeros(2, 4, 5))
    assert work.macs == 2 * 4 * 3 * 7 * (5 + 7)


def test_layer_without_a_rule_is_an_error() -> None:
    with pytest.raises(ValueError, match="no rule counts"), count_macs(nn.Sequential(nn.Bilinear(2, 2, 2))):
        pass


# Controls --------------------------------------------------------------------------


def test_random_agent_plays_saves_and_repeats(tmp_path: Path) -> None:
    agent = RandomAgent(vec(), seed=5).learn(400)
    assert agent.num_timesteps == 400
    assert len(agent.ep_info_buffer or ()) == 0  # DummyVecEnv without Monitor says nothing of episodes
    agent.save(tmp_path / "random")
    again = RandomAgent.load(tmp_path / "random", vec())
    with meter() as cost:
        drawn = [a.predict(np.zeros(1000, int), deterministic=True)[0] for a in (agent, again)]
    assert np.array_equal(drawn[0], drawn[1])
    assert drawn[0].mean() == pytest.approx(0.5, abs=0.05)
    assert cost.processed == 0
    assert agent.action_probabilities(np.arange(3)).tolist() == [[0.5, 0.5]] * 3
    assert evaluate_policy(agent, agent.env, n_eval_episodes=4)[0] <= 1


@pytest.mark.parametrize("obs", ["index", "pixels"])
def test_tables_learn_the_corridor(obs: str, tmp_path: Path) -> None:
    learner: TabularQ | ThumbnailQ = ThumbnailQ(vec(obs=obs), seed=0)
    learner.learn(1000)
    seen = np.arange(CELLS - 1) if obs == "index" else BANK[: CELLS - 1]
    assert learner.predict(seen, deterministic=True)[0].tolist() == [1] * (CELLS - 1)
    with meter() as cost:
        learner.predict(seen[1], deterministic=True)
    assert (cost.selection, cost.recognition) == (0, 64)
    learner.save(tmp_path / "t")
    again = ThumbnailQ.load(tmp_path / "t", vec(obs=obs))
    assert np.array_equal(again.policy.action_values(seen), learner.policy.action_values(seen))


def test_table_of_the_hidden_state_learns_the_corridor() -> None:
    learner = TabularQ(vec(), seed=0).learn(500)
    assert learner.values[: CELLS - 1].argmax(axis=1).tolist() == [1] * (CELLS - 1)


def test_thumbnail_never_met_is_taken_for_the_nearest() -> None:
    learner = ThumbnailQ(vec(), seed=0)
    assert not learner.policy.action_values(np.arange(CELLS)).any()
    learner.learn(500)
    met, rows = learner.policy.action_values(np.arange(CELLS)), len(learner.values)
    order = np.array([3, 0, 2, 1])
    learner.set_bank(np.clip(BANK[order].astype(int) + 20, 0, 255).astype(np.uint8))
    assert np.array_equal(learner.policy.action_values(np.arange(4)), met[order])
    assert len(learner.values) == rows  # looking is not learning


def test_threshold_questions_part_percepts_that_differ() -> None:
    words = ThresholdVocabulary(patch=3, candidates=8)
    retinas = [Retina(image) for image in BANK]
    rng = np.random.default_rng(0)
    questions = words.candidates(Tree().root, retinas, rng, 0)
    for question in questions:
        means = [
            image[question.top : question.top + 3, question.left : question.left + 3, question.channel].mean()
            for image in BANK
        ]
        answers = [words.answer(question, retina) for retina in retinas]
        assert answers == [int(mean > question.level) for mean in means]
        assert 0 < sum(answers) < CELLS
    assert words.candidates(Tree().root, retinas[:1] * 3, rng, 0) == []
    assert words.question_from_json(list(questions[0])) == questions[0]
    assert isinstance(words.question_from_json([1, 2, 0, 3.5]), Threshold)


def test_pixel_tree_learns_the_corridor_from_single_pixels(tmp_path: Path) -> None:
    learner = PixelTree(vec(), seed=0, episodes_per_phase=20).learn(6000)
    assert learner.predict(np.arange(CELLS - 1), deterministic=True)[0].tolist() == [1] * (CELLS - 1)
    with meter() as cost:
        learner.predict(2, deterministic=True)
    assert cost.recognition <= cost.operations["questions"] <= learner.grown_tree.rows
    learner.save(tmp_path / "tree")
    again = PixelTree.load(tmp_path / "tree", vec())
    assert again.vocabulary.patch == 1
    assert again.tree.to_json() == learner.tree.to_json()
