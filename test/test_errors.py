"""Kinds of errors: the same for each message that is wrong in the same way."""

from eulerparams_control.errors import InvalidMessageError, kind_of


def test_errors_that_differ_in_numbers_or_content_are_of_one_kind():
    texts = (
        "joint_states moved by 0.31 rad in 1e-3 s, frame 'a': {'elbow_joint': nan}",
        "joint_states moved by -12 rad in 0.002 s, frame 'b'; expected [1, 2]",
    )
    first, second = (kind_of(InvalidMessageError(text)) for text in texts)
    assert first == second
    assert first.startswith("joint_states moved by")


def test_errors_that_differ_in_words_are_of_different_kinds():
    texts = ("joint_states has a non-finite position: 1", "joint_states lacks elbow_joint: 1")
    assert len({kind_of(InvalidMessageError(text)) for text in texts}) == len(texts)
