"""The part of reading a C3D file that runs in a process of its own: ``python c3d_process.py FILE OUT``.

Damaged heads send ezc3d (1.7) into endless loops, forbidden memory or all of the memory there is; none of that may
happen to the program that asked. Exit 0 and an archive OUT, or exit 3 and a message on stdout.
"""

import json
import sys

import ezc3d
import numpy as np

MOST_BYTES = 8 << 30
REFUSED = 3


def main(path: str, out: str) -> int:
    """Read with ezc3d; write points (4, M, T), residuals (M, T), first frame, rate, last field, and POINT as JSON."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    except (ImportError, ValueError, OSError):
        pass  # this system knows no such limits: the time limit of the caller is left
    try:
        table = ezc3d.c3d(path)
        header, group = table["header"]["points"], table["parameters"]["POINT"]
        values = {key: np.asarray(entry["value"]).tolist() for key, entry in group.items() if "value" in entry}
        with open(out, "wb") as stream:
            np.savez(
                stream,
                points=np.asarray(table["data"]["points"], dtype=np.float64),
                residuals=np.asarray(table["data"]["meta_points"]["residuals"], dtype=np.float64)[0],
                first_frame=int(header["first_frame"]),
                rate_hz=float(header["frame_rate"]),
                parameters=np.array(json.dumps(values)),
                last_field=np.ravel(table["parameters"].get("TRIAL", {}).get("ACTUAL_END_FIELD", {}).get("value", [])),
            )
    except Exception as error:  # ezc3d hands on whatever its C++ code throws
        sys.stdout.write(" ".join(str(error).split()) or type(error).__name__)
        return REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
