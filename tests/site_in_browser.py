# SPDX-License-Identifier: LGPL-3.0-or-later
"""The site in a browser: python3 site_in_browser.py SITE PICTURES (make test-browser).

Every page of the built site is opened from its file, without a network, on a screen and on a
telephone: no error may stand on its console, and nothing may be wider than the window. Then the
search page is asked the questions of ``questions.json``, which `check_questions.py` has written
beside the pages: their answers must be the same. Pictures of some pages are put into PICTURES.
"""

import json
import sys
import time
from pathlib import Path
from urllib.parse import quote

from in_browser import PATIENCE, SOFTWARE, Browser

SIZES = {"screen": (1280, 900), "telephone": (390, 844)}
SEEN = ("index", "tutorials/4_all_solutions", "recipes/index", "verification", "theory/1_laws")
FIRST = 3  # results that must agree
TOO_WIDE = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
RESULTS = (
    "[...document.querySelectorAll('#search-results ul.search > li > a')].map((a) =>"
    " new URL(a.href).pathname)"
)


def resized(b, size):
    """The window, also where it is narrower than a browser's own may be."""
    width, height = size
    seen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    b.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", seen)


def opened(b, address):
    b.driver.get("about:blank")
    b.driver.get(address)
    end = time.monotonic() + PATIENCE
    while b.ask("document.readyState") != "complete":
        assert time.monotonic() < end, address
        time.sleep(0.02)


def pages(b, site, pictures):
    """Errors and widths of all pages; the pages are names without their suffix."""
    # What the theme makes its pages of is no page.
    files = sorted(f for f in site.rglob("*.html") if "_static" not in f.parts)
    assert len(files) > 100, files
    wrong = []
    for name, size in SIZES.items():
        resized(b, size)
        for file in files:
            page = str(file.relative_to(site).with_suffix(""))
            opened(b, file.resolve().as_uri())
            wide = b.ask(TOO_WIDE)
            if wide > 0:
                wrong.append(f"{page} on a {name}: {wide} pixels too wide")
            log = [e["message"] for e in b.driver.get_log("browser") if e["level"] == "SEVERE"]
            wrong += [f"{page} on a {name}: {message}" for message in log]
            if page in SEEN:
                b.driver.save_screenshot(str(pictures / f"{page.replace('/', '_')}_{name}.png"))
    assert not wrong, "\n".join(wrong)
    return len(files)


def questions(b, site):
    """Compare answers of the search page with those computed without a browser."""
    resized(b, SIZES["screen"])
    computed = json.loads((site / "questions.json").read_text())
    search = (site / "search.html").resolve()
    for question, expected in computed.items():
        opened(b, f"{search.as_uri()}?q={quote(question)}")
        end = time.monotonic() + PATIENCE
        while len(found := b.ask(RESULTS)) < min(FIRST, len(expected)):
            assert time.monotonic() < end, (question, found, expected[:FIRST])
            time.sleep(0.05)
        shown = [str(Path(f).relative_to(search.parent).with_suffix("")) for f in found[:FIRST]]
        assert shown == expected[:FIRST], (question, shown, expected[:FIRST])
    return len(computed)


def main():
    site = Path(sys.argv[1])
    pictures = Path(sys.argv[2])
    pictures.mkdir(parents=True, exist_ok=True)
    b = Browser(site, SOFTWARE)
    try:
        count = pages(b, site, pictures)
        asked = questions(b, site)
    finally:
        b.close()
    print(f"{count} pages of {site} in two sizes, {asked} questions")


if __name__ == "__main__":
    main()
