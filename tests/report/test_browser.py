"""The report in a real browser: drawn, silent, self-contained, and deaf to what a log tries to inject."""

import os
import shutil

import pytest
import validated_case as validation
from playwright.sync_api import sync_playwright

from ident.report.html import write_report
from ident.report.pages.evaluate import evaluate_page
from ident.report.pages.improve import improve_page
from ident.report.pages.info import info_page
from ident.report.pages.steering import steering_page
from ident.report.pages.tyres import tyres_page
from ident.report.pages.validate import validate_page

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]


def find_browser():
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        reason = f"no browser installed: none of {', '.join(BROWSERS)} is on the PATH"
        if os.environ.get("IDENT_REQUIRE_BROWSER") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    return found


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        instance = playwright.chromium.launch(executable_path=find_browser(), args=ARGUMENTS)
        yield instance
        instance.close()


@pytest.fixture(scope="module")
def report(steering_case, info_result, tmp_path_factory):
    pages = [info_page(info_result), steering_page(*steering_case)]
    return write_report(tmp_path_factory.mktemp("report"), pages)


class Visit:
    """A page that is open, with all it said and asked for."""

    def __init__(self, browser, report, address="", **options):
        self.tab = browser.new_page(viewport={"width": 1280, "height": 900}, **options)
        self.said, self.asked = [], []
        self.tab.on("console", lambda message: self.said.append(message.text))
        self.tab.on("pageerror", lambda error: self.said.append(str(error)))
        self.tab.on("request", lambda request: self.asked.append(request.url))
        self.tab.goto(report.as_uri() + address)
        self.drawn()

    def drawn(self, count=0):
        """Wait until the figures in sight are drawn, of the responses at least ``count``."""
        self.tab.wait_for_function("document.body.dataset.ready")
        layers = "document.querySelectorAll('#steering-responses .cartesianlayer')"
        wanted = f"count => {layers}.length >= count"
        self.tab.wait_for_function(wanted, arg=count)
        self.tab.wait_for_timeout(200)

    def boxes(self, selector):
        return [element.bounding_box() for element in self.tab.query_selector_all(selector)]


@pytest.fixture(scope="module")
def visit(browser, report):
    opened = Visit(browser, report)
    yield opened
    opened.tab.close()


DRAWN = """root => [...document.querySelectorAll(root + ' .figure')]
    .filter(figure => figure.offsetParent && !figure.closest('details:not([open])'))
    .map(figure => [...figure.querySelectorAll('path.js-line, path.point, .barlayer path')]
        .filter(path => (path.getAttribute('d') || '').length > 20).length)"""


def drawn_lines(tab, root):
    """Count the drawn paths with data of each visible figure below ``root``."""
    return tab.evaluate(DRAWN, root)


def test_the_first_screen_holds_verdict_parameters_and_responses(visit):
    for selector in (".verdict", ".lead table", ".lead .figure"):
        box = visit.boxes(f"#steering {selector}")[0]
        assert box["width"] > 400
        assert box["y"] + box["height"] <= 900
    assert "Adequate" in visit.tab.inner_text("#steering .verdict")
    assert "0.1222" in visit.tab.inner_text("#steering .lead table")


def test_every_figure_in_sight_is_drawn_with_data(visit):
    counts = drawn_lines(visit.tab, "#steering")
    assert len(counts) >= 4
    assert min(counts) > 0
    assert counts[0] >= 16


def test_nothing_is_said_asked_for_or_executed(visit):
    assert visit.said == []
    assert [url for url in visit.asked if not url.startswith(("file:", "data:", "blob:"))] == []
    assert len([url for url in visit.asked if url.startswith("file:")]) == 1
    assert visit.tab.evaluate("window.injected") is None


def test_hostile_names_are_shown_as_text(visit):
    assert "</script><script>window.injected=2</script>" in visit.tab.inner_text("#steering-experiments")
    assert "<img src=x onerror=" in visit.tab.inner_text("#steering-refused")
    assert visit.tab.query_selector_all("main img") == []


def test_a_run_is_drawn_when_it_is_opened(visit):
    before = len(drawn_lines(visit.tab, "#steering-responses"))
    for summary in visit.tab.query_selector_all("#steering-responses summary"):
        summary.click()
    visit.drawn(before + 3)
    assert min(drawn_lines(visit.tab, "#steering-responses")) > 0
    assert visit.said == []


def test_the_stages_are_pages_of_one_file(visit):
    visit.tab.click("nav a.stage[data-page=info]")
    assert visit.tab.is_visible("#info .verdict")
    assert not visit.tab.is_visible("#steering .verdict")
    assert visit.tab.title() == "Logs – ident"
    visit.tab.wait_for_selector("#info .figure .yaxislayer-above", state="attached")
    assert "/vehicle/steering_wheel" in visit.tab.text_content("#info .figure .yaxislayer-above")
    visit.tab.click("nav a.stage[data-page=steering]")
    visit.tab.click("nav.contents.current a[href='#steering-model']")
    visit.tab.wait_for_timeout(300)
    assert 0 <= visit.tab.query_selector("#steering-model").bounding_box()["y"] < 850
    assert visit.said == []
    assert visit.tab.evaluate("window.injected") is None


def test_dark_screens_get_light_lines(browser, report):
    opened = Visit(browser, report, color_scheme="dark")
    colours = opened.tab.evaluate(
        "[...document.querySelectorAll('#steering .lead .js-line')].map(p => getComputedStyle(p).stroke)"
    )
    assert "rgb(240, 242, 244)" in colours
    assert "rgb(21, 24, 28)" not in colours
    opened.tab.close()


def test_an_injected_script_would_not_run(browser, report, tmp_path):
    text = report.read_text(encoding="utf-8")
    broken = tmp_path / "broken.html"
    script = "<script>window.injected=9</script>"
    image = "<img src='https://example.invalid/x' onerror='window.injected=8'>"
    broken.write_text(text.replace("<main>", f"<main>{script}{image}", 1), encoding="utf-8")
    opened = Visit(browser, broken)
    assert opened.tab.evaluate("window.injected") is None
    assert any("Content Security Policy" in line for line in opened.said)
    opened.tab.close()


# --- tyres -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tyres_report(steering_case, tyres_case, tmp_path_factory):
    pages = [steering_page(*steering_case), tyres_page(*tyres_case)]
    return write_report(tmp_path_factory.mktemp("report"), pages)


@pytest.fixture(scope="module")
def tyres_visit(browser, tyres_report):
    opened = Visit(browser, tyres_report)
    yield opened
    opened.tab.close()


def test_the_first_screen_of_the_tyres_holds_verdict_parameters_and_curves(tyres_visit):
    for selector in (".verdict", ".lead table", ".lead .figure .cartesianlayer"):
        box = tyres_visit.boxes(f"#tyres {selector}")[0]
        assert box["width"] > 400
        assert box["y"] + box["height"] <= 900
    assert "334.0" in tyres_visit.tab.inner_text("#tyres .lead table")


def test_every_figure_of_the_tyres_is_drawn_and_nothing_is_said_or_executed(tyres_visit):
    counts = drawn_lines(tyres_visit.tab, "#tyres")
    assert len(counts) >= 5
    assert min(count for index, count in enumerate(counts) if index != len(counts) - 1) > 0
    assert tyres_visit.tab.query_selector_all("#tyres-correlation .heatmaplayer .hm")
    assert tyres_visit.said == []
    assert tyres_visit.tab.evaluate("window.injected") is None
    assert "<img src=x onerror=" in tyres_visit.tab.inner_text("#tyres-signals")
    assert tyres_visit.tab.query_selector_all("main img") == []


def test_the_scale_of_the_points_follows_a_dark_screen(browser, tyres_report):
    opened = Visit(browser, tyres_report, color_scheme="dark")
    fills = opened.tab.evaluate(
        "[...document.querySelectorAll('#tyres .lead path.point')].map(p => getComputedStyle(p).fill)"
    )
    assert len(set(fills)) > 20
    assert "rgb(226, 238, 244)" in fills
    assert "rgb(35, 58, 70)" not in fills
    assert opened.said == []
    opened.tab.close()


# --- evaluation ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def evaluate_visit(browser, tyres_case, evaluate_case, tmp_path_factory):
    pages = [tyres_page(*tyres_case), evaluate_page(*evaluate_case)]
    opened = Visit(browser, write_report(tmp_path_factory.mktemp("report"), pages))
    yield opened
    opened.tab.close()


def test_the_first_screen_of_the_evaluation_holds_verdict_models_and_all_four_panels(evaluate_visit):
    assert "cost [ns/step]" in evaluate_visit.tab.inner_text("#evaluate .lead table").replace("\n", " ")
    for selector in (".verdict", ".lead table", ".lead .figure"):
        box = evaluate_visit.boxes(f"#evaluate {selector}")[0]
        assert box["width"] > 400
        assert box["y"] + box["height"] <= 900
    table, holder = (evaluate_visit.boxes(f"#evaluate .lead {one}")[0] for one in ("table", ".table"))
    assert table["width"] <= holder["width"] + 1
    panels = ", ".join(f"#evaluate .lead .subplot.{name}" for name in ("xy", "x2y2", "x3y3", "x4y4"))
    assert len(evaluate_visit.tab.query_selector_all(f".cartesianlayer :is({panels})")) == 4


def test_every_figure_of_the_evaluation_is_drawn_and_nothing_is_said_or_executed(evaluate_visit):
    counts = drawn_lines(evaluate_visit.tab, "#evaluate")
    assert len(counts) == 5
    assert min(counts) > 0
    assert evaluate_visit.tab.query_selector_all("#evaluate .lead .heatmaplayer .hm")
    assert evaluate_visit.said == []
    assert evaluate_visit.tab.evaluate("window.injected") is None
    assert "<img src=x onerror=" in evaluate_visit.tab.inner_text("#evaluate-runs")
    assert evaluate_visit.tab.query_selector_all("main img") == []


def test_a_table_is_downloaded_as_csv_and_json_without_a_network(evaluate_visit):
    for suffix, begin in (("csv", "model,input,over,signal,rms"), ("json", '[\n {\n  "model"')):
        link = f"#evaluate .lead a[download$='.{suffix}']"
        with evaluate_visit.tab.expect_download() as waited:
            evaluate_visit.tab.click(link)
        assert waited.value.suggested_filename == f"evaluate_models.{suffix}"
        assert waited.value.path().read_text(encoding="utf-8").startswith(begin)
    assert [url for url in evaluate_visit.asked if not url.startswith(("file:", "data:", "blob:"))] == []


# --- improvement -----------------------------------------------------------------------------------------


@pytest.fixture(
    scope="module", params=["named", "equivalent", "unexplained", "adequate", "actuator", "sensors"]
)
def improve_visit(browser, improve_cases, tmp_path_factory, request):
    pages = [improve_page(*improve_cases[request.param])]
    opened = Visit(browser, write_report(tmp_path_factory.mktemp("report"), pages))
    opened.case = request.param
    yield opened
    opened.tab.close()


def test_the_first_screen_of_the_improvement_holds_verdict_errors_and_figure(improve_visit):
    drawn = () if improve_visit.case == "sensors" else (".lead .figure .cartesianlayer",)
    for selector in (".verdict", ".lead table", *drawn):
        box = improve_visit.boxes(f"#improve {selector}")[0]
        assert box["width"] > 400
        assert box["y"] + box["height"] <= 900
    table, holder = (improve_visit.boxes(f"#improve .lead {one}")[0] for one in ("table", ".table"))
    assert table["width"] <= holder["width"] + 1


def test_every_figure_of_the_improvement_is_drawn_and_nothing_is_said_or_executed(improve_visit):
    counts = drawn_lines(improve_visit.tab, "#improve")
    assert len(counts) >= {"sensors": 0, "adequate": 2}.get(improve_visit.case, 5)
    bars = len(improve_visit.tab.query_selector_all("#improve-confirmation .barlayer .point"))
    assert bars == {"actuator": 1, "adequate": 0, "sensors": 0}.get(improve_visit.case, 3)
    assert sum(count == 0 for count in counts) == (bars > 0)  # bars are paths too short to be counted
    assert improve_visit.said == []
    assert improve_visit.tab.evaluate("window.injected") is None
    assert improve_visit.tab.query_selector_all("main img") == []
    assert "<img src=x onerror=" in improve_visit.tab.inner_text("#improve")
    if improve_visit.case not in {"adequate", "sensors"}:
        assert improve_visit.boxes("#improve-effect math mi")[0]["height"] > 5


@pytest.fixture(scope="module")
def validate_visit(browser, tmp_path_factory):
    pages = [validate_page(*validation.case())]
    opened = Visit(browser, write_report(tmp_path_factory.mktemp("report"), pages))
    yield opened
    opened.tab.close()


def test_the_first_screen_of_the_validation_holds_verdict_and_table(validate_visit):
    for selector in (".verdict", ".lead table"):
        box = validate_visit.boxes(f"#validate {selector}")[0]
        assert box["width"] > 400
        assert box["y"] + box["height"] <= 900
    table, holder = (validate_visit.boxes(f"#validate .lead {one}")[0] for one in ("table", ".table"))
    assert table["width"] <= holder["width"] + 1


def test_every_figure_of_the_validation_is_drawn_and_nothing_is_said_or_executed(validate_visit):
    for summary in validate_visit.tab.query_selector_all("#validate details:not([open]) > summary"):
        summary.click()
    validate_visit.tab.wait_for_timeout(300)
    maps = validate_visit.tab.query_selector_all("#validate-pairs .heatmaplayer image")
    assert len(maps) == 3
    counts = drawn_lines(validate_visit.tab, "#validate")
    assert len(counts) == 16
    assert sum(count == 0 for count in counts) == 1  # the maps are pictures
    assert validate_visit.said == []
    assert validate_visit.tab.evaluate("window.injected") is None
    assert validate_visit.tab.query_selector_all("main img") == []
    assert "<img src=x onerror=" in validate_visit.tab.inner_text("#validate-logged")
