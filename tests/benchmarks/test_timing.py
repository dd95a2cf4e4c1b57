"""The timing helper gives everybody the same turns."""

from benchmarks.timing import interleaved


def test_calls_take_turns():
    """After one warm-up each, the calls alternate; none is favoured by a quiet spell of the machine."""
    order: list[str] = []
    times = interleaved({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, repeats=3, sample_s=0.0)
    assert "".join(order) == "ab" * 4
    assert times["a"].n_samples == times["b"].n_samples == 3
    assert times["a"].median_s > 0


def test_a_call_beyond_its_budget_is_made_once():
    """Its first call is then its only sample."""
    order: list[str] = []
    times = interleaved({"slow": lambda: order.append("slow")}, repeats=3, budget_s=0.0)
    assert order == ["slow"]
    assert (times["slow"].n_samples, times["slow"].spread) == (1, 0.0)
