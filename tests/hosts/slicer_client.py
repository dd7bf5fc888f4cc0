"""Sends a file to `ferrostep serve --web` by a client that was written for OctoPrint, and asks what slicers ask.

    slicer_client.py ADDRESS KEY FILE

Prints one JSON object.
"""

import json
import sys

from octorest import OctoRest


def main():
    address, key, file = sys.argv[1:4]
    client = OctoRest(url=f"http://{address}", apikey=key)
    seen = {
        "version": client.version,
        "settings": client.settings(),
        "uploaded": client.upload(file),
        "printer": client.printer(),
        "job": client.job_info(),
    }
    try:
        OctoRest(url=f"http://{address}", apikey=key[::-1])
    except RuntimeError as refusal:
        seen["refused"] = str(refusal)
    print(json.dumps(seen))


main()
