"""Shows that the run time links without design code.

usage: link_test.py NM PROGRAM RUNTIME_LIBRARY DESIGN_LIBRARY

PROGRAM links the run-time library alone and runs a bank; it must hold none of the functions that the
design library defines, and the run-time library must not ask for any.
"""
import subprocess
import sys


def symbols(nm, binary, kinds):
    """Names of the symbols of these nm kinds, demangled."""
    output = subprocess.run([nm, "--demangle", binary], check=True, capture_output=True,
                            text=True).stdout
    found = set()
    for line in output.splitlines():
        parts = line.split(maxsplit=2) if line[:1] != " " else [None] + line.split(maxsplit=1)
        if len(parts) == 3 and parts[1] in kinds:
            found.add(parts[2])
    return found


def main(nm, program, runtime_library, design_library):
    design = {name for name in symbols(nm, design_library, "T") if "faultline::" in name}
    if not any("design_bank" in name for name in design):
        return f"{design_library}: found no design_bank; the test would prove nothing"
    if not any("ResidualBank::step" in name for name in symbols(nm, program, "T")):
        return f"{program}: found no ResidualBank::step; the test would prove nothing"
    held = design & symbols(nm, program, "TtW")
    if held:
        return f"{program} holds design code: {sorted(held)}"
    asked = design & symbols(nm, runtime_library, "U")
    if asked:
        return f"{runtime_library} asks for design code: {sorted(asked)}"
    print(f"none of the {len(design)} functions of the design library is in the run time")
    return None


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
