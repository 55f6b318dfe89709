#!/usr/bin/env python3
"""ask_page.py CHROMIUM PAGE SCRIPT [OPTION…]: loads PAGE (a file) in a Chromium without a screen, runs the JavaScript of the
file SCRIPT there and prints {"value": what it returned or promised, "exceptions": those of the page's own scripts} as JSON.
Speaks the DevTools protocol through a pipe: JSON messages, each ended by a zero byte. Gives up after four minutes."""
import fcntl, json, os, pathlib, signal, subprocess, sys, tempfile

chromium, page, script = sys.argv[1:4]
signal.alarm(240)


def pipe():
    """Both ends well away from 3 and 4, where the browser wants its own."""
    return [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in os.pipe()]


to_browser, to_browser_end = pipe()
from_browser_end, from_browser = pipe()
user = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
browser = subprocess.Popen(
    [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
     "--window-size=1280,900", "--remote-debugging-pipe", f"--user-data-dir={user.name}", *sys.argv[4:]],
    pass_fds=(3, 4), preexec_fn=lambda: (os.dup2(to_browser, 3), os.dup2(from_browser, 4)), stderr=subprocess.DEVNULL)
os.close(to_browser)
os.close(from_browser)

buffered, exceptions, last_id = b"", [], 0


def receive():
    global buffered
    while b"\0" not in buffered:
        part = os.read(from_browser_end, 1 << 16)
        if not part:
            sys.exit("the browser has gone")
        buffered += part
    message, buffered = buffered.split(b"\0", 1)
    message = json.loads(message)
    if message.get("method") == "Runtime.exceptionThrown":
        details = message["params"]["exceptionDetails"]
        exceptions.append(details.get("exception", {}).get("description", details["text"]))
    return message


def call(method, session=None, **parameters):
    global last_id
    last_id += 1
    message = {"id": last_id, "method": method, "params": parameters, **({"sessionId": session} if session else {})}
    os.write(to_browser_end, json.dumps(message).encode() + b"\0")
    while (answer := receive()).get("id") != last_id:
        pass
    if "error" in answer:
        sys.exit(f"{method}: {answer['error']['message']}")
    return answer["result"]


target = call("Target.createTarget", url="about:blank")["targetId"]
session = call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
call("Page.enable", session)
call("Runtime.enable", session)
last_id += 1
os.write(to_browser_end, json.dumps({"id": last_id, "sessionId": session, "method": "Page.navigate",
                                     "params": {"url": pathlib.Path(page).resolve().as_uri()}}).encode() + b"\0")
while receive().get("method") != "Page.loadEventFired":
    pass
answer = call("Runtime.evaluate", session, expression=pathlib.Path(script).read_text(), awaitPromise=True, returnByValue=True)
if "exceptionDetails" in answer:
    sys.exit(f"{script}: {answer['exceptionDetails'].get('exception', {}).get('description')}")
print(json.dumps({"value": answer["result"].get("value"), "exceptions": exceptions}))
call("Browser.close")
browser.wait()
