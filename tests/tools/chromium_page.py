"""A page in headless Chromium, driven over its debugging protocol."""
import base64
import http.client
import json
import os
import shutil
import subprocess
import tempfile
import time

from faultline_program import wait_for
from web_socket import WebSocket

START_S = 60


class ChromiumPage:
    """A browser with one page; the errors on its console are in `complaints`."""

    def __init__(self, *arguments):
        self.profile = tempfile.mkdtemp(prefix="faultline-chromium.")
        environment = {**os.environ, "HOME": self.profile, "XDG_CONFIG_HOME": self.profile,
                       "XDG_CACHE_HOME": self.profile}
        self.process = subprocess.Popen(
            ["chromium", "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
             "--remote-debugging-port=0", "--remote-allow-origins=*", f"--user-data-dir={self.profile}", *arguments,
             "about:blank"], env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, start_new_session=True)
        try:
            file = f"{self.profile}/DevToolsActivePort"
            port = wait_for(lambda: self.port_in(file), START_S, 0.05)
            page = wait_for(lambda: self.pages(port), START_S, 0.05)[0]
            self.socket = WebSocket(port, "/devtools/page/" + page["id"])
        except BaseException:
            self.close()
            raise
        self.number, self.complaints = 0, []
        for domain in ("Runtime", "Log", "Page"):
            self.call(f"{domain}.enable")

    @staticmethod
    def port_in(file):
        if not os.path.exists(file):
            return None
        with open(file, encoding="utf-8") as lines:
            line = lines.readline()
        return int(line) if line.endswith("\n") else None

    @staticmethod
    def pages(port):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=START_S)
        connection.request("GET", "/json/list")
        pages = json.loads(connection.getresponse().read())
        connection.close()
        return [page for page in pages if page["type"] == "page"]

    def call(self, method, **parameters):
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": parameters}).encode())
        while True:
            message = self.socket.receive()
            if message.get("id") == self.number:
                assert "error" not in message, message
                return message["result"]
            self.take_event(message)

    def take_event(self, message):
        parameters = message.get("params", {})
        if message.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(parameters["exceptionDetails"]))
        elif message.get("method") == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "assert"):
            self.complaints.append(json.dumps(parameters["args"]))
        elif message.get("method") == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.complaints.append(json.dumps(parameters["entry"]))

    def go(self, url):
        """To the page, once it is read."""
        error = self.call("Page.navigate", url=url).get("errorText")
        assert not error, f"{url}: {error}"
        self.await_true(f'document.readyState === "complete" && location.href === {json.dumps(url)}', START_S)

    def evaluate(self, expression):
        """The value of an expression of JavaScript; of a promise what it comes to."""
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def await_true(self, expression, patience_s):
        deadline = time.monotonic() + patience_s
        while not self.evaluate(f"Boolean({expression})"):
            if time.monotonic() > deadline:
                raise AssertionError(f"waited {patience_s} s in vain for {expression}; the page says: "
                                     + str(self.evaluate("document.body.innerText"))[:2000])
            time.sleep(0.05)

    def screenshot(self, file, width=1250, height=1000, **features):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Emulation.setEmulatedMedia",
                  features=[{"name": name.replace("_", "-"), "value": value} for name, value in features.items()])
        time.sleep(0.5)
        with open(file, "wb") as out:
            out.write(base64.b64decode(self.call("Page.captureScreenshot")["data"]))

    def close(self):
        if getattr(self, "socket", None):
            try:
                self.call("Browser.close")
            except (OSError, ConnectionError, AssertionError):
                pass
            self.socket.close()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        shutil.rmtree(self.profile, ignore_errors=True)
