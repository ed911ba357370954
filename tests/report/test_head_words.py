"""Units on one head in words, from hand-built results."""

from types import SimpleNamespace

from tumblecal.report import head_amounts, head_files, head_words


def explanation(labels, equivalents=(), probability=0.05):
    return SimpleNamespace(
        shared=SimpleNamespace(labels=labels, equivalents=equivalents),
        probability=probability,
        by_unit=(),
        head_by_unit=(),
    )


def test_nothing_wrong_is_said_so_and_a_class_is_listed_once(monkeypatch):
    """Nine effects that the data cannot distinguish have one probability; a tenth has its own."""
    alike = [f"effect_{k}" for k in range(9)]
    origin = {"belongs_to": "head", "shared": 0.0495, "by_unit": 0.0}
    listed = {id: origin | {"shared": 0.0495 + 1e-6 * k} for k, id in enumerate(alike)} | {
        "second_order.x": {"belongs_to": "sensor", "shared": 0.0, "by_unit": 0.2}
    }
    monkeypatch.setattr(head_amounts, "origins", lambda found, entries: listed)
    nothing = explanation((), probability=0.93)
    explanations = [nothing, explanation((alike[0],), tuple((id,) for id in alike[1:]))]
    found = SimpleNamespace(
        joint=SimpleNamespace(explanations=explanations, best=nothing), levels=[], implausible=(), verdict="adequate"
    )
    table = head_files._origins_table(found, {})
    assert [row[1:] for row in table.rows] == [["sensor", "0.000", "0.200"], ["head", "0.050", "0.000"]]
    assert sorted(table.rows[1][0].split(" or ")) == alike and table.rows[0][0] == "second_order.x"
    assert head_words._headline(found, "", "all units") == (
        "no error common to the units was found. Errors of individual units, if any, are listed below."
    )
