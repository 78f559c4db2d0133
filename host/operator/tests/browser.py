"""The operator's page and its commissioning in a real browser, by keyboard only, against `nearfield run` with the twin.

    pip install playwright==1.65.2 axe-playwright-python==0.1.8
    python3 browser.py --program target/release/nearfield --browser /usr/bin/chromium --out target/page

Tells every rule and whether it holds, and leaves screenshots in the folder. Exit code 1 = a rule is broken. Nothing is clicked:
all input is keys. Accessibility is judged by axe-core with the rules of WCAG 2.0 to 2.2, levels A and AA; that finds what a
program can find, it is no test with a screen reader.
"""

import argparse
import json
import re
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, sync_playwright

TOKEN = "a token that only this test knows"
PERSON = "Test Person"
WIDE, NARROW = (1280, 900), (360, 740)
# What every page may ask of a person's fingers (WCAG 2.2, 2.5.8), pixels.
SMALLEST_TARGET = 24
# The twin's hands lay a rod three times and press twice as often; a loaded computer needs its time.
PATIENCE_S = 240
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
FOCUSABLE = """() => [...document.querySelectorAll('a, button, input, [tabindex="0"]')]
    .filter((one) => one.getClientRects().length && !one.disabled)
    .map((one) => one.id || one.getAttribute('href') || one.textContent)"""

broken: list[str] = []


def rule(holds: bool, words: str, found: object = "") -> None:
    """One rule; what was found is told where it does not hold."""
    print(f"{'holds ' if holds else 'BROKEN'}  {words}" + ("" if holds else f": {found}"), flush=True)
    if not holds:
        broken.append(words)


def small_rig(program: str, folder: Path) -> dict[str, int]:
    """The twin's own rig with pictures of half the size, which a loaded computer renders fast enough."""
    made = [program, "twin", "render", "--scene", "clean", "--out", str(folder / "scene")]
    subprocess.run(made, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    text = (folder / "scene" / "rig.toml").read_text()

    def halved(match: re.Match[str]) -> str:
        name, value = match.group(1), float(match.group(2))
        if name in ("width", "height"):
            return f"{name} = {int(value) // 2}"
        # The middle of the first pixel is 0: a picture begins half a pixel before it.
        return f"{name} = {value / 2 if name in ('fx', 'fy') else (value + 0.5) / 2 - 0.5}"

    text = re.sub(r"^(width|height|fx|fy|cx|cy) = ([\d.]+)$", halved, text, flags=re.MULTILINE)
    (folder / "rig.toml").write_text(text)
    return {name: int(re.search(rf"^{name} = (\d+)$", text, re.MULTILINE)[1]) for name in ("width", "height")}


@contextmanager
def sensor(program: str, with_token: bool):
    """`nearfield run` over a clean floor, recording; gives the page's address."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        size = small_rig(program, folder)
        (folder / "token").write_text(TOKEN + "\n")
        token = 'token_file = "token"\n' if with_token else ""
        (folder / "nearfield.toml").write_text(
            f'profile = "height"\n[camera]\nwidth = {size["width"]}\nheight = {size["height"]}\n'
            f'[page]\nlisten = "127.0.0.1:0"\n{token}[recording]\ndirectory = "recordings"\n'
        )
        command = [program, "run", "--config", "nearfield.toml"]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            yield address_of(process)
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=60)
            rule(process.returncode == 0, "the run ends cleanly on SIGINT", process.returncode)


def address_of(process: subprocess.Popen) -> str:
    said = []
    for line in process.stdout:
        said.append(line)
        if found := re.search(r"http://[\d.]+:\d+", line):
            return found[0]
    sys.exit("`nearfield run` has ended without a page:\n" + "".join(said))


class Watch:
    """What a browser's tab complains of, and where it goes."""

    def __init__(self, page: Page, home: str):
        self.page, self.home = page, home
        self.complaints: list[str] = []
        self.elsewhere: list[str] = []
        page.on("console", lambda message: message.type in ("error", "warning") and self.complaints.append(message.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: request.url.startswith((home, "data:")) or self.elsewhere.append(request.url))

    def judge(self, words: str, refused: int = 0) -> None:
        """The browser itself tells each refusal (401) as an error; a test that provokes them says how many."""
        own = [text for text in self.complaints if "401 (Unauthorized)" not in text]
        rule(own == [], f"{words}: no complaint in the console", own)
        rule(len(self.complaints) - len(own) == refused, f"{words}: {refused} requests were refused", self.complaints)
        rule(self.elsewhere == [], f"{words}: nothing is asked of anybody else", self.elsewhere)
        self.complaints.clear()


def look(page: Page, out: Path, name: str) -> None:
    """Both widths: nothing sticks out, targets are large enough, axe-core finds nothing; one screenshot each."""
    for width, height in (WIDE, NARROW):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(700)
        where = f"{name}, {width} px"
        reach = page.evaluate("document.documentElement.scrollWidth")
        rule(reach <= width, f"{where}: nothing sticks out to the side", reach)
        small = page.evaluate(
            """(least) => [...document.querySelectorAll('button, input, footer a')]
                .map((one) => [one.id || one.textContent, one.getBoundingClientRect()])
                .filter(([, box]) => box.width && Math.min(box.width, box.height) < least).map(([one]) => one)""",
            SMALLEST_TARGET,
        )
        rule(small == [], f"{where}: what is to be touched is {SMALLEST_TARGET} px and more", small)
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            results = Axe().run(page, options={"runOnly": {"type": "tag", "values": RULES}})
            found = [
                (violation["id"], [node["html"][:120] for node in violation["nodes"]])
                for violation in results.response["violations"]
            ]
            rule(found == [], f"{where}, {scheme}: axe-core finds nothing", found)
        page.emulate_media(color_scheme="light")
        page.screenshot(path=out / f"{name}-{width}.png", full_page=True)


def walk(page: Page, home: str, when: str) -> None:
    """Tab goes through everything that can be used, once, in the order of the page, and shows where it is."""
    page.goto(home)
    # The form comes when the page has learnt that orders are taken: on a loaded computer seconds later.
    page.wait_for_selector("#commission-form", state="visible", timeout=PATIENCE_S * 1000)
    page.wait_for_timeout(1000)
    expected, reached, hidden = page.evaluate(FOCUSABLE), [], []
    for _ in expected:
        page.keyboard.press("Tab")
        name, outline = page.evaluate(
            """() => { const one = document.activeElement;
                return [one.id || one.getAttribute('href') || one.textContent, getComputedStyle(one).outlineStyle]; }"""
        )
        reached.append(name)
        if outline == "none":
            hidden.append(name)
    rule(reached == expected, f"{when}: Tab reaches everything once, in the order of the page", (reached, expected))
    rule(hidden == [], f"{when}: where the keyboard is can be seen", hidden)
    page.goto(home)
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    rule(page.url.endswith("#state"), f"{when}: the first key leads past the head of the page to the state", page.url)


def wait_until(page: Page, expression: str) -> None:
    """Asked from here: the page's own policy forbids it to evaluate text, also to a test."""
    end = time.monotonic() + PATIENCE_S
    while not page.evaluate(expression):
        if time.monotonic() > end:
            instruction = page.inner_text("#commission-section")
            sys.exit(f"BROKEN  within {PATIENCE_S} s: {expression}\n{instruction}")
        page.wait_for_timeout(200)


def go_to(page: Page, wanted: str) -> None:
    """By Tab alone."""
    page.wait_for_selector(f"#{wanted}", state="visible", timeout=PATIENCE_S * 1000)
    for _ in range(60):
        if page.evaluate("document.activeElement.id") == wanted:
            return
        page.keyboard.press("Tab")
    rule(False, f"Tab reaches {wanted}")


def fill(page: Page, field: str, text: str) -> None:
    go_to(page, field)
    page.keyboard.press("Control+A")
    page.keyboard.type(text)


def commission(page: Page) -> dict:
    return page.evaluate("fetch('/api/commission').then((answer) => answer.json())")


def status(page: Page) -> dict:
    return page.evaluate("fetch('/api/status').then((answer) => answer.json())")


def try_everything(page: Page) -> list[int]:
    """Every way to change anything, without the token and with wrong ones, as a page that was tampered with would."""
    return page.evaluate(
        """async () => {
            const codes = [];
            for (const where of ['/api/commission/begin', '/api/commission/end', '/api/mark'])
                for (const authorization of [null, '', 'Bearer', 'Bearer ', 'Bearer wrong', 'Basic YTpi'])
                    codes.push((await fetch(where, { method: 'POST', body: 'Mallory',
                        headers: authorization === null ? {} : { Authorization: authorization } })).status);
            return codes;
        }"""
    )


def nothing_changed(page: Page, words: str) -> None:
    view = commission(page)
    rule(not view["running"] and view["person"] == "", f"{words}: no commissioning has begun", view)
    rule(not view["has_protocol"], f"{words}: there is no protocol", view)


def without_token(browser, program: str, out: Path) -> None:
    with sensor(program, with_token=False) as home:
        page = browser.new_page()
        watch = Watch(page, home)
        page.goto(home)
        page.wait_for_selector("#commission-section:not([hidden])")
        page.wait_for_timeout(1500)
        rule(page.locator("form:visible").count() == 0, "no token is set: there is nothing to fill in")
        look(page, out, "read-only")
        watch.judge("read-only")
        codes = try_everything(page)
        rule(set(codes) == {401}, "no token is set: every request to change something is refused", codes)
        watch.judge("read-only, tampered with", refused=len(codes))
        nothing_changed(page, "no token is set")
        page.close()


def with_token(browser, program: str, out: Path) -> None:
    with sensor(program, with_token=True) as home:
        page = browser.new_page()
        watch = Watch(page, home)
        walk(page, home, "before")
        codes = try_everything(page)
        rule(set(codes) == {401}, "without the token every request to change something is refused", codes)
        nothing_changed(page, "without the token")
        fill(page, "commission-person", "Mallory")
        fill(page, "commission-token", "a wrong token, long enough")
        page.keyboard.press("Enter")
        wait_until(page, "document.getElementById('commission-answer').textContent.includes('token')")
        nothing_changed(page, "with a wrong token")
        watch.judge("wrong tokens", refused=len(codes) + 1)
        look(page, out, "commissioning-before")
        go_through(page, watch, out)
        # Now with stops in their table, and a protocol.
        walk(page, home, "after")
        protocol(browser, home, out)
        page.close()


def go_through(page: Page, watch: Watch, out: Path) -> None:
    """The whole commissioning, begun by keys; the twin's hands do what the page asks."""
    fill(page, "commission-person", PERSON)
    fill(page, "commission-token", TOKEN)
    page.keyboard.press("Enter")
    wait_until(page, "document.getElementById('commission-button').textContent === 'End'")
    rule(commission(page)["person"] == PERSON, "with the token it begins, and knows who does it", commission(page))
    wait_until(page, "document.getElementById('commission-instruction').textContent.includes('across the stripe')")
    look(page, out, "commissioning-running")
    live = page.locator("#commission-instruction").get_attribute("aria-live")
    rule(live == "polite", "a screen reader is told each instruction", live)
    wait_until(page, "fetch('/api/commission').then((answer) => answer.json()).then((view) => view.passed !== null)")
    view = commission(page)
    failed = [check for step in view["steps"] for check in step["checks"] if not check["passed"]]
    rule(view["passed"] is True, "the twin's commissioning is passed", failed)
    page.wait_for_selector("#commission-protocol:not([hidden])")
    look(page, out, "commissioning-after")
    watch.judge("the commissioning")


def protocol(browser, home: str, out: Path) -> None:
    page = browser.new_page()
    watch = Watch(page, home)
    page.goto(home + "/commission.html")
    rule(PERSON in page.inner_text("body"), "the protocol names who did it")
    look(page, out, "protocol")
    watch.judge("the protocol")
    page.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", required=True, help="nearfield")
    parser.add_argument("--browser", required=True, help="Chromium or Chrome")
    parser.add_argument("--out", type=Path, required=True, help="folder for the screenshots")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    program = str(Path(arguments.program).resolve())
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=arguments.browser, args=["--no-sandbox"])
        without_token(browser, program, arguments.out)
        with_token(browser, program, arguments.out)
        browser.close()
    print(json.dumps({"broken": broken}))
    sys.exit(1 if broken else 0)


main()
