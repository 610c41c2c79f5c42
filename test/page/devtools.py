"""Chromium without a window, driven over its DevTools protocol."""

import asyncio
import base64
import contextlib
import json
import subprocess
import tempfile
import time
from pathlib import Path

import chromium
from tornado.websocket import websocket_connect

OPTIONS = (
    '--mute-audio',
    '--autoplay-policy=no-user-gesture-required',
    '--remote-debugging-port=0',
)
START_S = 60.0
ANSWER_S = 60.0
LARGEST = 64 * 2**20


class Browser:
    """A browser that has never been used, and its event loop."""

    def __init__(self, path):
        self.profile = tempfile.TemporaryDirectory(prefix='page_browser_')
        self.loop = asyncio.new_event_loop()
        self.process = subprocess.Popen(
            chromium.command(path, self.profile.name, *OPTIONS, 'about:blank'),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        port = Path(self.profile.name) / 'DevToolsActivePort'
        until = time.monotonic() + START_S
        while not port.exists() or '\n' not in port.read_text():
            assert self.process.poll() is None, 'the browser has ended'
            assert time.monotonic() < until, 'the browser does not start'
            time.sleep(0.05)
        number, place = port.read_text().split()
        self.address = f'ws://127.0.0.1:{number}'
        self.pages = []
        self.targets = Channel(self, place)

    def open(self, address='about:blank', *, width=1280, height=800, scale=1.0, dark=False):
        """Open a page of its own."""
        return Page(self, address, width, height, scale, dark)

    def frame(self, address):
        """Return a frame of another origin than its page, by its address."""
        until = time.monotonic() + START_S
        while True:
            found = self.targets.call('Target.getTargets', filter=[{'type': 'iframe'}])
            for target in found['targetInfos']:
                if target['url'] == address:
                    return Document(self, f'/devtools/page/{target["targetId"]}')
            assert time.monotonic() < until, f'no frame shows {address}: {found}'
            time.sleep(0.05)

    def close(self):
        """End the browser."""
        for page in list(self.pages):
            page.close()
        self.targets.hang_up()
        self.process.terminate()
        try:
            self.process.wait(10.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.loop.close()
        # The last of its processes may still write there.
        with contextlib.suppress(OSError):
            self.profile.cleanup()


class Channel:
    """One connection of the protocol: calls, and events in between."""

    def __init__(self, browser, place):
        self._loop = browser.loop
        self._count = 0
        self._socket = self._loop.run_until_complete(self._connect(browser.address + place))

    async def _connect(self, address):
        return await websocket_connect(address, max_message_size=LARGEST)

    def take(self, message):
        """Take an event."""

    async def _call(self, method, params):
        self._count += 1
        number = self._count
        await self._socket.write_message(
            json.dumps({'id': number, 'method': method, 'params': params})
        )
        while True:
            text = await asyncio.wait_for(self._socket.read_message(), ANSWER_S)
            assert text is not None, 'the browser has closed the page'
            message = json.loads(text)
            if message.get('id') == number:
                assert 'error' not in message, f'{method}: {message["error"]}'
                return message['result']
            self.take(message)

    def call(self, method, **params):
        """Call a method of the protocol."""
        return self._loop.run_until_complete(self._call(method, params))

    def hang_up(self):
        """Close the connection, and wait until it is closed."""

        async def closed():
            self._socket.close()
            while await self._socket.read_message() is not None:
                pass

        with contextlib.suppress(TimeoutError):
            self._loop.run_until_complete(asyncio.wait_for(closed(), ANSWER_S))


class Document(Channel):
    """What runs expressions: a page, or a frame of another origin in one."""

    def run(self, script):
        """Return the value of an expression, awaited."""
        done = self.call(
            'Runtime.evaluate', expression=script, returnByValue=True, awaitPromise=True
        )
        details = done.get('exceptionDetails')
        assert details is None, details
        return done['result'].get('value')

    def wait(self, script, seconds=20.0):
        """Wait until an expression is true; while the page is being loaded it is not."""
        tried = f'(() => {{ try {{ return Boolean({script}); }} catch {{ return false; }} }})()'
        until = time.monotonic() + seconds
        while not self.run(tried):
            assert time.monotonic() < until, f'in vain: {script}; {self.described()}'
            time.sleep(0.05)

    def described(self):
        """Return what a failed test should say of it."""
        return ''


class Page(Document):
    """
    A page in a browser.

    `said` is what came on its console, with errors and refusals of the policy; `failed` are
    requests that were answered by an error; `audio` are the events of WebAudio, if it is listened
    to.
    """

    def __init__(self, browser, address, width, height, scale, dark):
        self.browser = browser
        self.said = []
        self.failed = []
        self.audio = []
        self._target = browser.targets.call('Target.createTarget', url='about:blank')['targetId']
        super().__init__(browser, f'/devtools/page/{self._target}')
        browser.pages.append(self)
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            self.call(f'{domain}.enable')
        self.resize(width, height, scale)
        self.shade(dark)
        if address != 'about:blank':
            self.go(address)

    def take(self, message):
        """Take an event: what is said on the console, and what is refused."""
        method, params = message.get('method'), message.get('params', {})
        if method == 'Runtime.consoleAPICalled':
            texts = [str(one.get('value', one.get('description'))) for one in params['args']]
            self.said.append(f'{params["type"]}: {" ".join(texts)}')
        elif method == 'Runtime.exceptionThrown':
            details = params['exceptionDetails']
            thrown = details.get('exception', {}).get('description', '')
            self.said.append(f'exception: {details["text"]} {thrown}')
        elif method == 'Log.entryAdded':
            entry = params['entry']
            self.said.append(f'{entry["level"]}: {entry["text"]} {entry.get("url", "")}')
        elif method == 'Network.responseReceived' and params['response']['status'] >= 400:
            self.failed.append((params['response']['status'], params['response']['url']))
        elif method and method.startswith('WebAudio.'):
            self.audio.append((method.removeprefix('WebAudio.'), params))

    def go(self, address):
        """Open an address."""
        self.call('Page.navigate', url=address)

    def resize(self, width, height, scale=1.0):
        """Give the window another size, in CSS pixels."""
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=False,
        )

    def shade(self, dark, calm=False):
        """Let the system be dark or light, and ask for little motion."""
        features = [
            {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'},
            {'name': 'prefers-reduced-motion', 'value': 'reduce' if calm else 'no-preference'},
        ]
        self.call('Emulation.setEmulatedMedia', features=features)

    def described(self):
        """Return what a failed test should say of the page."""
        state = self.run("""[location.href, document.querySelector('#status')?.textContent,
            document.querySelector('#curtain')?.textContent,
            document.querySelector('#toast')?.textContent, globalThis.impactDamper?.counted.frames,
            globalThis.impactDamper?.history.impacts.length]""")
        return f'page: {state}; console: {self.said}; answers: {self.failed}'

    def text(self, selector):
        """Return the text of an element."""
        return self.run(f'document.querySelector({json.dumps(selector)})?.textContent')

    def click(self, selector):
        """Click on the middle of an element, as a mouse does."""
        where = self.run(f"""(() => {{
            const one = document.querySelector({json.dumps(selector)});
            one.scrollIntoView({{block: 'center', behavior: 'instant'}});
            const box = one.getBoundingClientRect();
            return [box.left + box.width / 2, box.top + box.height / 2]; }})()""")
        self.press(*where)

    def press(self, x, y):
        """Click on a place."""
        for kind, pressed in (('mouseMoved', 0), ('mousePressed', 1), ('mouseReleased', 0)):
            self.call(
                'Input.dispatchMouseEvent',
                type=kind,
                x=x,
                y=y,
                button='left',
                buttons=pressed,
                clickCount=int(kind != 'mouseMoved'),
            )

    def type(self, selector, text, *, enter=True):
        """Replace what is in a field by a text, with the keyboard."""
        self.run(f"""(() => {{ const one = document.querySelector({json.dumps(selector)});
            one.focus(); one.select(); }})()""")
        self.call('Input.insertText', text=text)
        if enter:
            self.key('Enter', 13)

    def key(self, name, code=0):
        """Press a key."""
        text = {'Enter': '\r', ' ': ' '}.get(name)
        for kind in ('keyDown', 'keyUp'):
            extra = {'text': text} if text and kind == 'keyDown' else {}
            self.call(
                'Input.dispatchKeyEvent', type=kind, key=name, windowsVirtualKeyCode=code, **extra
            )

    def screenshot(self, path=None, **options):
        """Return a picture of the window as PNG, and write it."""
        done = self.call('Page.captureScreenshot', **{'format': 'png', **options})
        content = base64.b64decode(done['data'])
        if path is not None:
            Path(path).write_bytes(content)
        return content

    def close(self):
        """Close the page."""
        self.browser.pages.remove(self)
        self.hang_up()
        self.browser.targets.call('Target.closeTarget', targetId=self._target)
