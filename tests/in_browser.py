"""Click through pages of records in Chromium: python3 in_browser.py FOLDER (make test-browser).

`test_explorer.py` wrote the pages to the folder. The browser opens each from its file, without a
network and with software rendering. Effects of clicks and keys are read from the page, and the
console must contain no errors. Pictures of the pages are stored beside them.
"""

import sys
import tempfile
import time
from pathlib import Path

from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver import ActionChains, Keys
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

FLAGS = (
    *("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-quic", "--host-resolver-rules=MAP * ~NOTFOUND"),
)
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
NO_WEBGL = ("--disable-gpu", "--disable-3d-apis")
PATIENCE = 30.0


class Browser:
    """A page in a browser."""

    def __init__(self, folder, flags, size=(1400, 1000)):
        self.folder = folder
        self._profile = tempfile.TemporaryDirectory()
        options = Options()
        options.binary_location = "/usr/bin/chromium"
        for flag in (*FLAGS, *flags, f"--user-data-dir={self._profile.name}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
        self.driver.set_window_size(*size)

    def close(self):
        self.driver.quit()
        self._profile.cleanup()

    def open(self, name, more=""):
        self.driver.get("about:blank")
        self.driver.get((self.folder / f"{name}.html").resolve().as_uri() + more)
        self.wait("document.body.dataset.ready === 'true'")

    def ask(self, expression):
        return self.driver.execute_script(f"return {expression}")

    def wait(self, expression):
        end = time.monotonic() + PATIENCE
        while not self.ask(expression):
            said = self.ask("byId('message').textContent")
            assert time.monotonic() < end, f"not so: {expression}; the page says {said!r}"
            time.sleep(0.05)

    def find(self, selector):
        return self.driver.find_element(By.CSS_SELECTOR, selector)

    def click(self, selector):
        """Click on an element, which may be drawn anew meanwhile."""
        end = time.monotonic() + PATIENCE
        while True:
            try:
                return self.find(selector).click()
            except StaleElementReferenceException:
                assert time.monotonic() < end, selector

    def choose(self, name, value):
        Select(self.find(f"#{name}")).select_by_value(value)

    def where(self):
        return self.ask("[now.series, now.index]")

    def settled(self):
        self.wait("drawing === null")

    def click_at(self, plot, x, y):
        """Click in a plot at a place in units of its axes."""
        left, top = self.ask(
            f"(() => {{ const p = byId('{plot}'), r = p.getBoundingClientRect(),"
            f" l = p._fullLayout; return [r.left + l.xaxis._offset + l.xaxis.d2p({x}),"
            f" r.top + l.yaxis._offset + l.yaxis.d2p({y})]; }})()"
        )
        actions = ActionChains(self.driver)
        actions.w3c_actions.pointer_action.move_to_location(round(left), round(top))
        actions.pause(0.3).click().perform()

    def press(self, *keys):
        ActionChains(self.driver).send_keys(*keys).perform()

    def picture(self, name):
        self.driver.save_screenshot(str(self.folder / f"{name}.png"))

    def no_errors(self):
        log = [line for line in self.driver.get_log("browser") if line["level"] == "SEVERE"]
        assert not log, log


def along_a_branch(b, name, dim):
    """Click on a point, use the slider and keys, and check the page."""
    b.open(name)
    count = b.ask("META.series[0].count")
    assert b.find("#title").text == "<b>Block</b> & γ"
    target = count // 2
    x, y = b.ask(f"[valueAt(0, {target}, 'gamma'), valueAt(0, {target}, byId('axis-y').value)]")
    b.click_at("diagram", x, y)
    b.wait(f"now.index === {target}")
    b.settled()
    assert b.ask("byId('body').dataset.state") == str(target)
    ring = b.ask(
        "[byId('diagram').data[diagram.ring].x[0], byId('diagram').data[diagram.ring].y[0]]"
    )
    assert ring == [x, y]
    drawn = b.ask("byId('body').data.map((t) => t.type)")
    assert ("mesh3d" in drawn) == (dim == 3)
    if dim == 3:
        to_scale(b)
    if dim == 2:  # a cell has several colours, which vary continuously
        colours = b.ask("new Set(byId('body').data.map((t) => t.fillcolor)).size")
        corners = b.ask("byId('body').data.map((t) => t.fill ? t.x.length : 0)")
        assert colours > 4
        assert sum(corners) > 4 * 5 * b.ask("body.cells.length")  # more than four triangles each
    b.press(Keys.ARROW_RIGHT)
    b.wait(f"now.index === {target + 1}")
    b.press(Keys.HOME)
    b.wait("now.index === 0")
    b.press(Keys.END)
    b.wait(f"now.index === {count - 1}")
    b.settled()
    # The slider by its own keys, and the button that plays.
    b.find("#slider").send_keys(Keys.ARROW_LEFT)
    b.wait(f"now.index === {count - 2}")
    b.find("#play").click()
    b.wait(f"!now.playing && now.index === {count - 1}")
    b.settled()
    b.no_errors()


def parts_of_branches(b, name):
    """Every part of a branch has the status that holds on it: before an event that before it."""
    b.open(name)
    b.choose("colour", "status")
    b.settled()
    wrong = b.ask(
        "(() => { const x = column(byId('axis-x').value), y = column(byId('axis-y').value);"
        " const lines = traces(x, y, 'status').filter((t) => t.mode === 'lines'); let bad = [];"
        " META.series.forEach((s) => { for (let i = 1; i < s.count; i++) {"
        "  const at = s.first + i;"
        "  const here = s.marks.some((m) => m.index === i && !(m.share < 1));"
        "  const kind = kindsOf(diagram.words[here ? at - 1 : at]);"
        "  const has = lines.some((t) => t.name === plain(kind) && t.x.some((v, k) =>"
        "   k > 0 && t.x[k - 1] === x[at - 1] && t.y[k - 1] === y[at - 1] && v === x[at]"
        "   && t.y[k] === y[at]));"
        "  if (!has) bad.push([s.name, i, kind]); } }); return bad; })()"
    )
    assert not wrong, wrong
    events = b.ask("META.series.flatMap((s) => s.marks.filter((m) => !(m.share < 1))).length")
    assert events > 0
    b.no_errors()


def tables(b, name, dim):
    """The table is sorted by a click, and a click on a row finds the point in the face."""
    b.open(name)
    rows = "[...document.querySelectorAll('#points tbody tr')]"
    column = dim + 4  # the pressure
    head = f"#points th[data-column='{column}']"
    assert "pressure" in b.find(head).text
    assert "rn: normal force, ≥ 0 in compression" in b.find("#points caption").text
    b.click(head)
    b.wait(f"document.querySelector(\"{head}\").textContent.endsWith('▴')")
    b.click(head)
    b.wait(f"document.querySelector(\"{head}\").textContent.endsWith('▾')")
    shown = b.ask(f"{rows}.map((r) => Number(r.cells[{column}].title))")
    exact = b.driver.execute_async_script(
        "const done = arguments[0];"
        "tableAt(faceNow(), stateNow()).then((table) => done([...table.pressure]))"
    )
    assert shown == sorted(exact, reverse=True)
    assert max(exact) > 0
    b.click("#points tbody tr")
    b.wait("now.point >= 0")
    b.settled()
    assert b.ask("now.point") == exact.index(max(exact))
    assert b.find("#points tr.chosen")
    picked = b.ask("byId('face').data.filter((t) => t.marker?.symbol === 'circle-open')[0].x[0]")
    assert picked is not None
    b.no_errors()


def controls(b, name):
    """Change axes, colours and scale; the choices survive a reload."""
    b.open(name)
    b.choose("axis-y", "distance")
    b.wait("byId('diagram').layout.yaxis.title.text === 'distance'")
    for colour in ("series", "status", "gamma"):
        b.choose("colour", colour)
    b.wait("byId('diagram').data.some((t) => t.marker?.showscale)")
    b.settled()
    for colour in ("strain", "ux", "none", "displacement"):
        b.choose("body-colour", colour)
        b.settled()
    for colour in ("pressure", "shear", "un", "none", "status"):
        b.choose("face-colour", colour)
        b.settled()
    scale = b.find("#scale")
    scale.clear()
    scale.send_keys("0", Keys.TAB)
    b.settled()
    for box in ("edges", "arrows", "before", "obstacles", "names"):
        b.find(f"#{box}").click()
        b.settled()
    b.find("#back").click()
    b.settled()
    before = b.where()
    b.driver.refresh()
    b.wait("document.body.dataset.ready === 'true'")
    assert b.where() == before
    assert b.ask("byId('axis-y').value") == "distance"
    assert b.ask("byId('scale').value") == "0"
    b.no_errors()


def solutions(b, name):
    """Check the list of solutions at a gamma and the verdicts of the proofs."""
    b.open(name)
    b.find("[data-tab='solutions']").click()
    b.wait("!byId('solutions').hidden")
    selected = b.ask("valueNow('gamma')")
    assert float(b.find("#gamma").get_property("value")) == selected
    b.find("#solutions button.counted").click()
    b.wait("byId('solutions').textContent.includes('3 solutions, proved (by a proof)')")
    given = b.find("#gamma")
    given.clear()
    given.send_keys("0.033", Keys.TAB)
    b.wait("byId('solutions').textContent.includes('no proof was given')")
    assert "1 solution on the recorded branches" in b.find("#solutions").text
    b.click("#solutions tbody tr")
    b.settled()
    gammas = b.ask("Array.from(column('gamma'))")
    assert b.where() == [0, min(range(len(gammas)), key=lambda i: abs(gammas[i] - 0.033))]
    b.find("[data-tab='values']").click()
    b.wait("!byId('values').hidden")
    assert f"point {b.ask('now.index')} (0 to" in b.find("#values").text
    b.no_errors()


def between_points(b, name):
    """A click between two points of a piecewise linear branch shows the interpolated state."""
    b.open(name)
    gammas, count = b.ask("[Array.from(column('gamma')), META.series[0].count]")
    # A segment that is long in both axes, away from other points.
    index = max(range(count - 1), key=lambda i: abs(gammas[i + 1] - gammas[i]))
    x, y = (
        b.ask(f"(valueAt(0, {index}, '{n}') + valueAt(0, {index + 1}, '{n}')) / 2")
        for n in ("gamma", b.ask("byId('axis-y').value"))
    )
    b.click_at("diagram", x, y)
    b.wait("now.share > 0")
    b.settled()
    assert b.where() == [0, index]
    share = b.ask("now.share")
    assert 0.4 < share < 0.6
    low, high, mixed = b.driver.execute_async_script(
        "const done = arguments[0]; const state = stateNow();"
        "const at = (s) => tableAt(faceNow(), s).then((t) => [...t.pressure]);"
        "Promise.all([at({ low: state.low, share: 0 }), at({ low: state.high, share: 0 }),"
        " at(state)]).then(done)"
    )
    expected = [p + share * (q - p) for p, q in zip(low, high, strict=True)]
    size = max(map(abs, low + high))
    assert max(abs(p - q) for p, q in zip(mixed, expected, strict=True)) < 1e-12 * size
    assert b.ask("Number(byId('body').dataset.state)") == index + share
    assert "between points" in b.find("#where").text
    assert abs(b.ask("valueNow('gamma')") - x) < 0.1 * abs(gammas[index + 1] - gammas[index])
    b.click("[data-tab='solutions']")
    assert abs(float(b.find("#gamma").get_property("value")) - b.ask("valueNow('gamma')")) < 1e-12
    b.picture(f"{name}_between")
    b.click("#solutions tbody tr")
    b.settled()
    assert b.ask("now.share") > 0
    b.driver.refresh()
    b.wait("document.body.dataset.ready === 'true'")
    assert abs(b.ask("now.share") - share) < 1e-9
    b.press(Keys.ARROW_RIGHT)
    b.wait(f"now.index === {index + 1} && now.share === 0")
    b.no_errors()


def axes_at_the_data(b, name):
    """The axes of a diagram show the range of the data with a small margin."""
    b.open(name)
    for axis in ("x", "y"):
        low, high = b.ask(f"byId('diagram')._fullLayout.{axis}axis.range")
        values = [
            v for v in b.ask(f"Array.from(column(byId('axis-{axis}').value))") if v is not None
        ]
        span = max(values) - min(values)
        assert 0 < min(values) - low < 0.1 * span
        assert 0 < high - max(values) < 0.1 * span
    b.no_errors()


def to_scale(b):
    """A unit of length has the same size along the three axes of the scene."""
    scene = "byId('body')._fullLayout.scene"
    sizes = b.ask(
        f"['x', 'y', 'z'].map((c) => {{ const [low, high] = {scene}[c + 'axis'].range;"
        f" return {scene}.aspectratio[c] / (high - low); }})"
    )
    assert max(sizes) < (1 + 1e-9) * min(sizes), sizes


def rigid_surface(b, name, dim):
    """A record whose obstacle has vertices of its own shows it, exaggerated or not."""
    b.open(name)
    b.press(Keys.END)
    b.settled()
    for scale in ("1", "5"):
        given = b.find("#scale")
        given.clear()
        given.send_keys(scale, Keys.TAB)
        b.settled()
        drawn = b.ask(
            "byId('body').data.filter((t) => t.type === 'mesh3d' && t.opacity === 0.28)"
            ".map((t) => t.i.length)"
            if dim == 3
            else "byId('body').data.filter((t) => t.line?.width === 3).map((t) => t.x.length)"
        )
        assert len(drawn) == 1
        assert drawn[0] > 0
        if dim == 3:
            to_scale(b)
        b.picture(f"{name}_{scale}")
    b.no_errors()


def history(b):
    """A history opens at its last step, with the friction bound and without round-off."""
    b.open("history")
    assert not b.find("#obstacles").is_displayed()  # two bodies
    last = b.ask("META.series[0].count") - 1
    assert b.where() == [0, last]
    assert f"step {last} (0 to {last})" in b.find("#where").text
    assert "friction bound" in b.find("#points thead").text
    assert "± friction bound" in b.ask("byId('face').data.map((t) => t.name)")
    assert b.ask("[written(3e-17, 6, 1), written(3e-17, 6, 1e-16), written(3e-5, 6, 1)]") == [
        *("0", "3.0000e-17", "3.0000e-5"),
    ]
    assert "e-17" not in b.find("#points").text
    assert b.ask("[...column('contact_x'), ...column('support_1_x')].every((v) => v === 0)")
    b.choose("axis-x", "support_1_uy")
    b.choose("axis-y", "support_1_y")
    assert b.ask("byId('diagram').layout.yaxis.title.text") == "support_1_y"
    b.picture("history")
    b.no_errors()


def odd(b):
    """Records without bodies, of one point, and of ten thousand."""
    b.open("bare")
    assert "record with surface_displacement=True" in b.find("#notes").text
    b.press(Keys.END)
    b.settled()
    assert b.find("#values").text
    b.open("one")
    assert "point 0 (the only point)" in b.ask("byId('where').textContent")
    b.open("long")
    begun = time.monotonic()
    assert (
        b.ask("byId('diagram').data.reduce((n, t) => n + (t.customdata ? t.x.length : 0), 0)")
        < 2000
    )
    lines = (
        "byId('diagram').data.filter((t) => t.mode === 'lines').reduce((n, t) => n + t.x.length, 0)"
    )
    assert b.ask(lines) >= 10_000
    assert b.ask("byId('diagram').data.map((t) => t.name)")[:2] == ["stable", "unstable"]
    b.press(Keys.END, Keys.ARROW_LEFT)
    b.wait("now.index === 9998")
    b.settled()
    assert time.monotonic() - begun < 20
    assert "–" in b.find("#values").text
    b.no_errors()


def without_webgl(b):
    """The diagram, the contact face and the table of a body in 3D work, and the page says so."""
    b.open("branch_hex")
    assert "no WebGL" in b.find("#body").text
    x, y = b.ask("[valueAt(0, 3, 'gamma'), valueAt(0, 3, byId('axis-y').value)]")
    b.click_at("diagram", x, y)
    b.wait("now.index === 3")
    b.settled()
    assert len(b.driver.find_elements(By.CSS_SELECTOR, "#points tbody tr")) == 16
    assert b.ask("byId('face').data.length") > 2
    b.no_errors()
    b.open("branch_quad")
    assert b.ask("byId('body').data.length") > 2
    b.no_errors()


def narrow(b):
    """On a telephone nothing is wider than the screen."""
    for name in ("branch_quad", "bare"):
        b.open(name)
        time.sleep(0.3)
        wide = b.ask("document.documentElement.scrollWidth - window.innerWidth")
        assert wide <= 0, (name, wide)
        b.no_errors()


def main():
    folder = Path(sys.argv[1])
    b = Browser(folder, SOFTWARE)
    try:
        for name, dim in (("branch_quad", 2), ("branch_hex", 3)):
            along_a_branch(b, name, dim)
            parts_of_branches(b, name)
            tables(b, name, dim)
            controls(b, name)
            solutions(b, name)
            b.open(name)
            b.picture(name)
            axes_at_the_data(b, name)
        between_points(b, "linear")
        rigid_surface(b, "rigid_quad", 2)
        rigid_surface(b, "rigid_hex", 3)
        odd(b)
        history(b)
    finally:
        b.close()
    for check, flags, size in (
        (without_webgl, NO_WEBGL, (1400, 1000)),
        (narrow, SOFTWARE, (500, 900)),
    ):
        b = Browser(folder, flags, size)
        try:
            check(b)
        finally:
            b.close()
    print(f"pages of {folder} were clicked in")


if __name__ == "__main__":
    main()
