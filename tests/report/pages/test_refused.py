from __future__ import annotations

from ident.report.html import render
from ident.report.pages.refused import refused_page


def test_says_why_there_is_no_answer_and_takes_it_for_text() -> None:
    page = refused_page("tyres", "Tyres", "run <b>a</b> drives straight: drive curves")
    assert page.verdict is not None
    assert page.verdict.tone == "caution"
    html = render([page])
    assert "run &lt;b&gt;a&lt;/b&gt; drives straight: drive curves." in html
    assert "<b>a" not in html
