"""An agent on stdin and stdout for the tests: it prints a log line, then echoes every line with a mark.

`_exit` ends it, `_pid` tells its process id; with `--stubborn` it neither ends when its input closes nor
when it is told to.
"""

from __future__ import annotations

import json
import os
import signal
import sys

if "--stubborn" in sys.argv:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)

print("Loading models, this is no JSON", flush=True)
for line in sys.stdin:
    message = json.loads(line)
    if message.get("method") == "_exit":
        sys.exit(3)
    answer = {"jsonrpc": "2.0", "id": message.get("id"), "result": {"pid": os.getpid(), "heard": message}}
    print(json.dumps(answer), flush=True)

while "--stubborn" in sys.argv:
    signal.pause()
