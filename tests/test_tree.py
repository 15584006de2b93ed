"""Trees against direct computation: walks, numbers, pruning, criteria, files."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from attn_tree.tree import Tree, best_split, prune
from attn_tree.tree.criterion import (
    Evidence,
    delta_variance,
    holm,
    reductions_by_action,
    separation_p_values,
    variance_reductions,
)
from attn_tree.tree.node import Node
from attn_tree.tree.splitter import best_summed_split
from attn_tree.tree.storage import ArchiveError, read_archive, write_archive


def random_tree(rng: np.random.Generator, splits: int) -> Tree:
    """A tree whose questions are bit positions with up to four answers."""
    tree = Tree()
    for question in range(splits):
        leaves = tree.leaves
        leaf = leaves[rng.integers(len(leaves))]
        tree.split(leaf, question, {int(a): int(rng.integers(1, 9)) for a in range(rng.integers(2, 5))})
    return tree


trees = st.builds(
    lambda seed, splits: random_tree(np.random.default_rng(seed), splits),
    st.integers(0, 2**32 - 1),
    st.integers(0, 12),
)


@given(tree=trees, seed=st.integers(0, 1000))
def test_a_walk_follows_the_answers(tree: Tree, seed: int) -> None:
    answers = np.random.default_rng(seed).integers(0, 2, 20)  # every node has answers 0 and 1
    leaf = tree.walk(lambda question: int(answers[question]))
    node = leaf
    while node.parent is not None:
        assert node.parent.children[int(answers[node.parent.question])] is node
        node = node.parent
    assert node is tree.root and leaf.is_leaf


@given(tree=trees)
def test_figures_of_a_tree(tree: Tree) -> None:
    inside = [node for node in tree.nodes if not node.is_leaf]
    assert len(tree.leaves) == 1 + sum(len(node.children) - 1 for node in inside)
    assert tree.depth == pytest.approx(np.mean([len(leaf.path_questions()) for leaf in tree.leaves]))
    depths = [node.depth for node in tree.nodes]
    assert depths == sorted(depths)  # level order
    assert sorted(tree.level_order_numbers()) == sorted(leaf.row for leaf in tree.leaves)


def test_an_unseen_answer_goes_to_the_nearest_else_the_most_visited_child() -> None:
    tree = Tree()
    tree.split(tree.root, "q", {0: 3, 1: 9, 2: 1})
    assert tree.walk(lambda _: 7) is tree.root.children[1]
    assert tree.walk(lambda _: 7, lambda question, answer, seen: max(seen)) is tree.root.children[2]


@given(tree=trees, seed=st.integers(0, 1000))
def test_pruning_keeps_every_decision_and_leaves_the_grown_tree_alone(tree: Tree, seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.integers(0, 2, (tree.rows, 3)).astype(float)
    percepts = rng.integers(0, 4, (30, 20))

    def leaf(of: Tree, percept: np.ndarray) -> Node:
        return of.walk(lambda question: int(percept[question]))

    before = [leaf(tree, percept) for percept in percepts]
    actions = [int(values[node.row].argmax()) for node in before]
    size = len(tree.nodes)
    pruned, table = prune(tree, values, {node.row for node in before})
    assert [int(table[leaf(pruned, percept).row].argmax()) for percept in percepts] == actions
    assert len(tree.nodes) == size >= len(pruned.nodes)
    for node in pruned.nodes:  # nothing is left to prune
        if not node.is_leaf:
            assert len(node.children) >= 2
            kinds = {int(table[c.row].argmax()) if c.is_leaf else -1 for c in node.children.values()}
            assert len(kinds) > 1 or kinds == {-1}


def test_a_pruning_step_that_the_check_refuses_is_undone() -> None:
    tree = Tree()
    tree.split(tree.root, "q", {0: 1, 1: 1})
    values = np.tile([0.0, 1.0], (tree.rows, 1))
    assert len(prune(tree, values, {1, 2})[0].leaves) == 1
    assert len(prune(tree, values, {1, 2}, lambda *_: False)[0].leaves) == 2


@given(tree=trees)
def test_a_tree_survives_json(tree: Tree) -> None:
    twin = Tree.from_json(json.loads(json.dumps(tree.to_json())), lambda value: value)
    assert twin.to_json() == tree.to_json()


# Criteria ---------------------------------------------------------------------------------


def direct_reduction(means: np.ndarray, answers: np.ndarray, cross_validated: bool) -> float:
    """Variance reduction of one question as one would write it first."""
    n = len(means)
    if not cross_validated:
        groups = [means[answers == a] for a in set(answers)]
        return float(np.var(means) - sum(len(g) / n * np.var(g) for g in groups))
    before = after = 0.0
    for i in range(n):
        others = [j for j in range(n) if j != i]
        alike = [j for j in others if answers[j] == answers[i]] or others
        before += (means[i] - means[others].mean()) ** 2 / n
        after += (means[i] - means[alike].mean()) ** 2 / n
    return float(before - after)


@given(seed=st.integers(0, 2**32 - 1), m=st.integers(2, 12), cross_validated=st.booleans())
def test_variance_reduction_equals_the_direct_computation(seed: int, m: int, cross_validated: bool) -> None:
    rng = np.random.default_rng(seed)
    means, answers = rng.normal(size=m) * 10, rng.integers(0, 4, (m, 5))
    ours = variance_reductions(means, answers, cross_validated)
    direct = [direct_reduction(means, answers[:, q], cross_validated) for q in range(5)]
    np.testing.assert_allclose(ours, direct, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
def test_best_split_is_the_best_of_all_enumerated(seed: int) -> None:
    rng = np.random.default_rng(seed)
    percepts, actions = rng.integers(0, 6, 40), rng.integers(0, 3, 40)
    answers = rng.integers(0, 3, (6, 7))
    evidence = Evidence.gather(percepts, actions, rng.normal(size=40))
    split = best_split(evidence, answers, cross_validated=False)
    every = [
        direct_reduction(evidence.means[pairs], answers[evidence.percepts[pairs], q], False)
        for a in set(actions)
        for pairs in [evidence.of_action(a)]
        for q in range(7)
    ]
    if split is None:
        assert max(every) <= 1e-9
    else:
        assert split.reduction == pytest.approx(max(every))


def some_pairs(rng: np.random.Generator, percepts: int, actions: int) -> Evidence:
    """Evidence of which about a third is missing."""
    known = np.argwhere(rng.random((percepts, actions)) < 0.7)
    deltas = rng.normal(size=len(known)).round(2)
    return Evidence.gather(known[:, 0], known[:, 1], deltas)


@pytest.mark.parametrize("cross_validated", [False, True])
@given(seed=st.integers(0, 10_000), percepts=st.integers(2, 12))
def test_reductions_of_all_actions_at_once_are_those_of_each(
    cross_validated: bool, seed: int, percepts: int
) -> None:
    rng = np.random.default_rng(seed)
    evidence = some_pairs(rng, percepts, 4)
    answers = rng.integers(0, 2, (percepts, 5))
    expected = []
    for action in np.unique(evidence.actions):
        pairs = evidence.of_action(int(action))
        if np.ptp(evidence.means[pairs]) > 0:
            told = answers[evidence.percepts[pairs]]
            expected.append(variance_reductions(evidence.means[pairs], told, cross_validated))
    found, weights = reductions_by_action(evidence, answers.astype(float), cross_validated)
    np.testing.assert_allclose(found.T, np.reshape(expected, found.T.shape), atol=1e-4)
    assert (weights > 0).all() and weights.sum() <= 1 + 1e-9


def test_an_answer_in_doubt_counts_on_both_sides() -> None:
    evidence = Evidence.gather(np.arange(4), np.zeros(4, int), np.array([1.0, 1.0, -1.0, -1.0]))
    certain, doubtful, useless = np.array([1, 1, 0, 0]), np.array([1, 0.75, 0.25, 0]), np.full(4, 0.5)
    found, _ = reductions_by_action(evidence, np.column_stack([certain, doubtful, useless]), False)
    # Doubtful yes: 1.75 worth +1 and 0.25 worth -1, so a mean of 0.75 and a variance of 1 - 0.75².
    np.testing.assert_allclose(found[:, 0], [1, 0.75**2, 0], atol=1e-6)


def test_deviations_summed_over_actions_prefer_halving_the_classes_to_peeling_one_off() -> None:
    classes = np.repeat(np.arange(8), 4)
    percepts, actions = (a.ravel() for a in np.mgrid[:32, :8])
    evidence = Evidence.gather(percepts, actions, np.where(classes[percepts] == actions, 1.0, -1.0))
    peel, halve = classes == 0, classes < 4
    answers = np.column_stack([peel, halve]).astype(int)
    assert best_split(evidence, answers).question == 0
    assert best_summed_split(evidence, answers.astype(float)) == 1
    assert best_summed_split(evidence, answers.astype(float), least=17) is None


def test_evidence_of_some_percepts_is_that_of_the_others_left_out() -> None:
    rng = np.random.default_rng(0)
    evidence, chosen = some_pairs(rng, 9, 3), np.array([1, 4, 8])
    part = evidence.of_percepts(chosen)
    for number, percept in enumerate(chosen):
        np.testing.assert_array_equal(
            part.means[part.percepts == number], evidence.means[evidence.percepts == percept]
        )


def test_evidence_aggregates_repeats_and_aliasing_ignores_how_often() -> None:
    evidence = Evidence.gather(np.array([0, 0, 0, 1]), np.array([1, 1, 1, 1]), np.array([1.0, 3.0, 2.0, 6.0]))
    np.testing.assert_allclose(evidence.means, [2, 6])
    np.testing.assert_allclose(evidence.noise, [2 / 3, 0])
    assert delta_variance(evidence) == 4.0


def welch_of_every_answer(means: np.ndarray, answers: np.ndarray) -> float:
    met = np.unique(answers)
    if len(met) < 2:
        return 1.0
    p_values = [1.0]
    for answer in met if len(met) > 2 else met[:1]:
        inside, outside = means[answers == answer], means[answers != answer]
        if len(inside) > 1 and len(outside) > 1:
            p_values.append(stats.ttest_ind(inside, outside, equal_var=False).pvalue)
        elif len(inside) + len(outside) > 2:  # one percept borrows the variance of the others
            one, others = sorted((inside, outside), key=len)
            error = others.std(ddof=1) * np.array([1, len(others) ** -0.5])
            freedom = (error**2).sum() ** 2 / (error**4 / [1, len(others) - 1]).sum()
            t = abs(one.mean() - others.mean()) / np.hypot(*error)
            p_values.append(2 * stats.t.sf(t, freedom))
    return min(1.0, min(p_values) * (len(met) if len(met) > 2 else 1))


@given(st.integers(0, 10**6), st.integers(2, 12), st.integers(1, 4))
def test_p_values_are_welch_s_question_by_question(seed: int, m: int, highest: int) -> None:
    rng = np.random.default_rng(seed)
    noisy = Evidence(np.arange(m), np.zeros(m, int), rng.normal(size=m), np.ones(m), np.full(m, 5))
    answers = rng.integers(0, highest + 1, (m, 5))
    answers[:, 4] = 0  # parts nothing
    found = separation_p_values(noisy, np.arange(m), answers)
    expected = [welch_of_every_answer(noisy.means, column) for column in answers.T[:4]]
    np.testing.assert_allclose(found, [*expected, 1.0], rtol=1e-6)


def test_p_values_are_defined_without_variance() -> None:
    single = np.array([[0], [1]])
    for noise, expected in ((np.ones(2), 1.0), (np.zeros(2), 0.0)):
        pair = Evidence(np.arange(2), np.zeros(2, int), np.array([0.0, 1.0]), noise, np.full(2, 5))
        assert separation_p_values(pair, np.arange(2), single) == [expected]
    means = np.repeat([0.1, 0.3], 3)  # each answer's percepts agree: no chance, whatever the repeats
    flat = Evidence(np.arange(6), np.zeros(6, int), means, np.ones(6), np.ones(6))
    answers = np.column_stack([np.repeat([0, 1], 3), np.zeros(6, int)])
    np.testing.assert_array_equal(separation_p_values(flat, np.arange(6), answers), [0.0, 1.0])


def test_noise_alone_is_rarely_split() -> None:
    splits = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        deltas = rng.normal(size=300)
        evidence = Evidence.gather(np.repeat(np.arange(30), 10), np.zeros(300, int), deltas)
        answers = rng.integers(0, 2, (30, 40))
        splits += best_split(evidence, answers, significance=0.05) is not None
    assert splits <= 20  # 5% of 200 expected; P(more than 20 | p = 0.05) < 0.2%


def test_holm_against_the_textbook() -> None:
    np.testing.assert_allclose(holm(np.array([0.01, 0.04, 0.03, 0.005])), [0.03, 0.06, 0.06, 0.02])


# Files ------------------------------------------------------------------------------------


def test_an_archive_returns_what_it_was_given(tmp_path) -> None:
    arrays = {"a": np.arange(6).reshape(2, 3), "b": np.zeros(0, np.float32)}
    write_archive(tmp_path / "m.zip", {"x": [1, "é"]}, arrays)
    meta, back = read_archive(tmp_path / "m.zip")
    assert meta == {"x": [1, "é"]}
    assert all((back[k] == v).all() and back[k].dtype == v.dtype for k, v in arrays.items())


def test_truncated_and_hostile_archives_are_refused_in_one_line(tmp_path) -> None:
    path = tmp_path / "m.zip"
    write_archive(path, {"x": 1}, {"a": np.arange(1000)})
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    bad = [whole[: int(n)] for n in rng.integers(0, len(whole), 40)]
    bad += [b"", b"\x80\x04cos\nsystem\n(S'true'\ntR."]
    for data in bad:
        path.write_bytes(data)
        with pytest.raises(ArchiveError) as error:
            read_archive(path)
        assert "\n" not in str(error.value)


def test_a_pickled_array_inside_an_archive_is_not_unpickled(tmp_path) -> None:
    import zipfile

    ran = tmp_path / "ran"

    class Bomb:
        def __reduce__(self) -> tuple:
            return (ran.write_text, ("x",))

    np.save(tmp_path / "bomb.npy", np.array([Bomb()], dtype=object), allow_pickle=True)
    with zipfile.ZipFile(tmp_path / "m.zip", "w") as archive:
        archive.writestr("meta.json", "{}")
        archive.write(tmp_path / "bomb.npy", "bomb.npy")
    with pytest.raises(ArchiveError):
        read_archive(tmp_path / "m.zip")
    assert not ran.exists()
