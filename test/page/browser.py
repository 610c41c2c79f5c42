"""A browser, and pages that collect the messages of their console."""

import json
import os
import signal
import time
from pathlib import Path
from urllib.parse import urlsplit

from playwright.sync_api import Error, expect, sync_playwright
from running import DEADLINE_S

OPTIONS = ('--disable-gpu',)
#: A screen of two pictures per second. A page draws once for each, and to draw takes most of the
#: processor's time, whatever it shows.
SLOW_SCREEN = Path(__file__).with_name('slow_screen.js').read_text(encoding='utf-8')
expect.set_options(timeout=1000.0 * DEADLINE_S)


class Browser:
    """
    Chromium without a window.

    While it is open, this thread has an event loop that runs: `asyncio.run` cannot be used. The
    plugin of Playwright for pytest keeps it open until the last test, so that no other test of
    the run could.
    """

    def __init__(self, path, *, screen=SLOW_SCREEN):
        self._screen = screen
        self._driver = sync_playwright().start()
        self._browser = self._driver.chromium.launch(executable_path=path, args=OPTIONS)

    def open(self, address='about:blank', *, width=1280, height=800):
        """Open a page in a tab of its own, which takes three times as long as `Page.visit`."""
        context = self._browser.new_context(viewport={'width': width, 'height': height})
        context.add_init_script(self._screen)
        return Page(context, address, self.draw_again)

    def draw_again(self):
        """
        End the process that draws; Chromium starts another one.

        About one in a hundred runs of all tests of the page comes to a browser that waits for a
        picture for ever (version 156, without a window, on a busy machine).
        """
        session = self._browser.new_browser_cdp_session()
        for one in session.send('SystemInfo.getProcessInfo')['processInfo']:
            if one['type'] == 'GPU':
                os.kill(one['id'], signal.SIGKILL)
        session.detach()

    def close(self):
        """End the browser."""
        self._browser.close()
        self._driver.stop()


class Page:
    """
    A page.

    `console` is what came on its console, with errors and refusals of the policy.
    """

    def __init__(self, context, address, draw_again):
        self.context = context
        self.tab = context.new_page()
        self.tab.set_default_timeout(1000.0 * DEADLINE_S)
        self.console = []
        self._draw_again = draw_again
        self.tab.on('console', self._said)
        self.tab.on('pageerror', lambda error: self.console.append(f'exception: {error}'))
        self.tab.goto(address)

    def _said(self, message):
        """Take a message of the console; one comes from `slow_screen.js`."""
        if message.text == 'no picture':
            self._draw_again()
        else:
            self.console.append(f'{message.type}: {message.text}')

    def visit(self, address, size=(1280, 800)):
        """Load a page as one that has never been there before."""
        self.console.clear()
        self.shade(dark=False)
        self.resize(*size)
        if urlsplit(address)[:2] == urlsplit(self.tab.url)[:2] != ('file', ''):
            # In the process that has shown the page, which is twice as quick as in another one
            self.run(f"history.replaceState(null, '', {json.dumps(address)})")
            self.tab.reload()
        else:
            self.leave()
            self.tab.goto(address)
        return self

    def leave(self):
        """Show nothing."""
        if self.tab.url != 'about:blank':
            self.tab.goto('about:blank')

    def __call__(self, selector):
        """Return what stands at a selector."""
        return self.tab.locator(selector)

    def expect(self, selector):
        """Return what can be expected of what stands at a selector; it is waited for."""
        return expect(self.tab.locator(selector))

    def run(self, script):
        """Return the value of an expression, awaited."""
        return self.tab.evaluate(script)

    def wait(self, script):
        """Wait until an expression is true; while the page is being loaded it is not."""
        # `wait_for_function` evaluates texts, which the policy of the page forbids. The page looks
        # by itself, for a while: each question from here goes through two other processes.
        tried = f"""(async () => {{
            for (const end = Date.now() + 2000; Date.now() < end;) {{
                try {{ if ({script}) return true; }} catch {{ }}
                await new Promise(resolve => {{ setTimeout(resolve, 30); }});
            }}
            return false; }})()"""
        end = time.monotonic() + DEADLINE_S
        while True:
            try:
                if self.run(tried):
                    return
            except Error:
                time.sleep(0.05)
            assert time.monotonic() < end, f'in vain: {script}; {self.described()}'

    def drawn(self):
        """Wait until all that has changed is drawn, by the pictures of a whole turn."""
        self.run('new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))')

    def described(self):
        """Return what a failed test should say of the page."""
        state = self.run("""[location.href, document.querySelector('#status')?.textContent,
            document.querySelector('#curtain')?.textContent,
            document.querySelector('#toast')?.textContent,
            globalThis.impactDamper?.store.frames,
            globalThis.impactDamper?.history.impacts.length,
            globalThis.impactDamper?.history.changes.map(({ text, time }) => [text, time]),
            globalThis.impactDamper?.theory]""")
        return f'page: {state}; console: {self.console}'

    def click(self, selector):
        """Click on the middle of an element, as a mouse does, once it stands still and is met."""
        self(selector).click()

    def type(self, selector, text, *, enter=True):
        """Replace what is in a field by a text, with the keyboard."""
        self.run(f"""(() => {{ const one = document.querySelector({json.dumps(selector)});
            one.focus(); one.select(); }})()""")
        self.tab.keyboard.insert_text(text)
        if enter:
            self.key('Enter')

    def key(self, name):
        """Press a key."""
        self.tab.keyboard.press(name)

    def resize(self, width, height):
        """Give the window another size, in CSS pixels."""
        self.tab.set_viewport_size({'width': width, 'height': height})
        self.wait(f'innerWidth === {width}')

    def shade(self, dark, calm=False):
        """Let the system be dark or light, and ask for little motion."""
        self.tab.emulate_media(
            color_scheme='dark' if dark else 'light',
            reduced_motion='reduce' if calm else 'no-preference',
        )

    def close(self):
        """Close the page."""
        self.context.close()
