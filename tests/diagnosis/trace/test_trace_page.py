"""What the page says agrees with its verdict."""

import pytest


@pytest.mark.parametrize(
    ("verdict", "names", "color"),
    [
        ("traced", ["rate", "creep"], "tab:green"),
        ("traced", ["creep"], "tab:orange"),
        ("none", [], "tab:green"),
        ("unexplained", [], "tab:orange"),
    ],
    ids=["traced", "one of two", "none", "unexplained"],
)
def test_the_most_probable_is_green_only_where_it_was_given(verdict, names, color, monkeypatch):
    from matplotlib.colors import to_rgba  # whoever collects the tests has no need of pictures

    from sma_actuator.diagnosis.trace import page as pages
    from sma_actuator.report import Page

    drawn = []

    def kept(*arguments, **options):
        drawn.append(pages_figure(*arguments, **options))
        return drawn[-1]

    pages_figure = pages.figure
    monkeypatch.setattr(pages, "figure", kept)
    said = [(["creep", "rate"], 0.7), (["slip"], 0.29), (["rate"], 0.01)]
    report = {
        "verdict": verdict,
        "names": names,
        "probabilities": [{"hypothesis": hypothesis, "probability": share} for hypothesis, share in said],
    }
    page = Page("What the model lacks", "…")
    pages._probable(page, report)
    ((_, axes),) = drawn
    bars, labels = axes[0, 0].patches, [text.get_text().strip() for text in axes[0, 0].texts]
    assert labels == ["29%", "70%"]  # what is hardly probable is not drawn
    assert [bar.get_facecolor() for bar in bars] == [to_rgba("0.7"), to_rgba(color)]
    (caption,) = [part["caption"] for part in page.parts if part["kind"] == "figure"]
    assert caption.endswith("not given, or not all of it." if color == "tab:orange" else "green: given.")
