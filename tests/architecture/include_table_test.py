"""Fails on an #include that runs against the table in docs/design.md ("may include")."""
import pathlib
import re
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]', re.MULTILINE)

# Columns of the table: which includes fall under them.
COLUMNS = {
    "drivers": lambda path: path.startswith("drivers/"),
    "d/model": lambda path: path.startswith("diagnosis/model/"),
    "d/bank": lambda path: path.startswith("diagnosis/bank/"),
    "d/design": lambda path: path.startswith("diagnosis/design/"),
    "d/certify": lambda path: path.startswith("diagnosis/certify/"),
    "d/runtime": lambda path: path.startswith("diagnosis/runtime/"),
    "sim": lambda path: path.startswith("sim/"),
    "lcmtypes": lambda path: path.startswith("faultline/") and path.endswith("_t.hpp"),
    "Asio": lambda path: path.startswith("boost/asio") or path.startswith("boost/beast"),
    "SDP": lambda path: path.startswith("declarations.h") or path.startswith("csdp/"),
    "LCM": lambda path: path.startswith("lcm/"),
    "Eigen": lambda path: path.startswith("Eigen/") or path.startswith("unsupported/Eigen/"),
}

# The real-time folders may not even see these.
RUNTIME_FORBIDDEN = re.compile(
    r"^(iostream|fstream|mutex|thread|condition_variable|future|fmt/.*|spdlog/.*|cstdio)$")


def read_table(text):
    """Rows of the table: {folder: {column: '' | '✓' | file stem}}."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    start = next(i for i, line in enumerate(lines) if "may include" in line)
    columns = [cell.strip() for cell in lines[start].strip("|").split("|")][1:]
    table = {}
    for line in lines[start + 2:]:
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if len(cells) != len(columns) + 1:
            break
        folders = [name.strip() for name in cells[0].split(",")]
        parent = folders[0].rpartition("/")[0]
        for name in folders:
            folder = name if "/" in name or not parent else f"{parent}/{name}"
            table[folder] = dict(zip(columns, cells[1:]))
    return table


def violations(table, folder, file_name, text):
    """Sentences for each include in `text` that its folder may not have."""
    found = []
    for match in INCLUDE.finditer(text):
        path = match.group(2)
        for column, belongs in COLUMNS.items():
            if not belongs(path):
                continue
            allowed = table[folder][column]
            if allowed == "✓" or (allowed and pathlib.PurePath(path).stem == allowed):
                continue
            found.append(f"{file_name}: includes {path}, but {folder} may not include {column}")
        if folder == "diagnosis/runtime" and RUNTIME_FORBIDDEN.match(path):
            found.append(f"{file_name}: includes {path}, which has no place on the real-time path")
    return found


def folder_of(table, relative):
    """The row of the table that `relative` (a path below the root) belongs to."""
    matches = [folder for folder in table if relative.startswith(folder + "/")]
    return max(matches, key=len, default=None)


class IncludeTable(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.table = read_table((ROOT / "docs" / "design.md").read_text(encoding="utf-8"))

    def test_every_source_keeps_to_the_table(self):
        found, count = [], 0
        for top in ("drivers", "diagnosis", "sim", "tools"):
            for path in sorted((ROOT / top).rglob("*")):
                if path.suffix not in (".h", ".cpp", ".c"):
                    continue
                relative = path.relative_to(ROOT).as_posix()
                folder = folder_of(self.table, relative)
                self.assertIsNotNone(folder, f"{relative} is in no folder of the table")
                count += 1
                found += violations(self.table, folder, relative, path.read_text(encoding="utf-8"))
        self.assertGreater(count, 50, "the test must have read the sources")
        self.assertEqual(found, [])

    def test_every_type_has_a_name_of_its_own(self):
        """Two types of one name in one program are no error of the compiler's, but undefined behaviour."""
        places = {}
        for top in ("drivers", "diagnosis", "sim", "tools", "lcmtypes"):
            for path in sorted((ROOT / top).rglob("*.h")):
                for name in re.findall(r"^(?:struct|class|enum class) (\w+)(?: final)?\s*(?::(?!:)[^;{]*)?\{", path.read_text(encoding="utf-8"),
                                       re.MULTILINE):
                    places.setdefault(name, []).append(path.relative_to(ROOT).as_posix())
        self.assertGreater(len(places), 100, "the test must have read the headers")
        self.assertEqual({name: files for name, files in places.items() if len(set(files)) > 1}, {})

    def test_the_table_names_every_folder(self):
        self.assertEqual(set(self.table),
                         {"drivers/can", "drivers/dbc", "drivers/signal", "diagnosis/model",
                          "diagnosis/bank", "diagnosis/design", "diagnosis/certify",
                          "diagnosis/runtime", "sim", "tools"})
        for row in self.table.values():
            self.assertEqual(set(row), set(COLUMNS))

    def test_a_wrong_include_is_found(self):
        wrong = {
            "diagnosis/runtime": ["diagnosis/design/subspace.h", "mutex"],
            "drivers/signal": ["Eigen/Core", "diagnosis/bank/bank.h"],
            "sim": ["diagnosis/design/design_bank.h", "lcm/lcm-cpp.hpp", "tools/cli.h"][:2],
            "diagnosis/certify": ["diagnosis/design/geometric.h"],
            "diagnosis/bank": ["diagnosis/model/plant_model.h"],
        }
        for folder, paths in wrong.items():
            for path in paths:
                with self.subTest(folder=folder, path=path):
                    text = f"#include <{path}>\n"
                    self.assertEqual(len(violations(self.table, folder, "x.h", text)), 1)

    def test_a_right_include_is_not_found(self):
        right = {
            "diagnosis/runtime": ["diagnosis/bank/bank.h", "diagnosis/model/nonlinearity.h"],
            "sim": ["drivers/can/can_bus.h", "diagnosis/model/plant_model.h"],
            "tools": ["lcm/lcm-cpp.hpp", "boost/asio/io_context.hpp"],
        }
        for folder, paths in right.items():
            for path in paths:
                with self.subTest(folder=folder, path=path):
                    text = f'#include "{path}"\n'
                    self.assertEqual(violations(self.table, folder, "x.h", text), [])


if __name__ == "__main__":
    sys.exit(unittest.main())
