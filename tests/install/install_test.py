"""The installed libraries: an example outside the tree finds them, builds and runs."""
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
CMAKE, BUILD = os.environ["CMAKE"], os.environ["BUILD"]

# Starts the example on vcan0, sends until it has answered, ends it.
DIALOGUE = r"""
"$1" "$2" can:vcan0 > "$3" & example=$!
for _ in $(seq 100); do
  cansend vcan0 110#102700F0D8FF2A00; cansend vcan0 7FF#00
  grep -q Sensors1Cycle "$3" && break
  sleep 0.1
done
kill $example
"""

# Uses what each diagnosis library defines, so that the link proves that all is there.
USES_DIAGNOSIS = r"""
#include "diagnosis/certify/check.h"
#include "diagnosis/design/bank_request.h"
#include "diagnosis/design/design_bank.h"
#include "diagnosis/model/plant_file.h"
#include "diagnosis/runtime/residual_bank.h"
int main(int, char** argv) {
  const faultline::BankRequest request = faultline::read_bank_request(argv[1]);
  const faultline::PlantModel plant = faultline::read_plant(request.plant);
  return plant.n() == 3 ? 0 : 1;
}
"""

# Solves a semidefinite program in a folder whose param.csdp would spoil it: an integrator whose
# noisy state is measured.
USES_SOLVER = r"""
#include <cmath>
#include <cstdio>

#include "diagnosis/design/uio/observer_synthesis.h"
int main() {
  const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(1, 1), none(1, 0);
  faultline::ObserverModel model;
  model.A = model.C = model.F_x = one;
  model.F_y = 0.0 * one;
  model.M = Eigen::RowVector2d(1.0, 0.0);
  model.W = Eigen::RowVector2d(0.0, 1.0);
  model.w_bound = Eigen::Vector2d::Ones();
  model.E_o = none;
  model.E_i = none.transpose();
  model.x_bound = Eigen::VectorXd::Ones(1);
  const faultline::ObserverSynthesis observer = faultline::synthesise_observer(
      model, {0.0 * one, one, none}, faultline::output_error(model), 0.5, std::nullopt, {},
      faultline::ResidualWeight::kScalar);
  std::printf("%d %a %a", static_cast<int>(observer.status), observer.gain.sum(),
              observer.objective);
}
"""

HOSTILE_PARAMETERS = """axtol=1.0e-1
atytol=1.0e-1
objtol=1.0e-1
pinftol=1.0e1
dinftol=1.0e1
maxiter=1
minstepfrac=0.1
maxstepfrac=0.2
minstepp=1.0e-1
minstepd=1.0e-1
usexzgap=0
tweakgap=1
affine=1
printlevel=1
perturbobj=0
fastmode=1
"""

CMAKE_LISTS = """
cmake_minimum_required(VERSION 3.22)
project(uses_diagnosis LANGUAGES CXX)
find_package(faultline 0.1 REQUIRED)
add_executable(uses_diagnosis main.cpp)
target_link_libraries(uses_diagnosis PRIVATE faultline::diagnosis_design
  faultline::diagnosis_certify faultline::diagnosis_runtime faultline::drivers_signal)
"""


def run(*command, **options):
    result = subprocess.run([str(part) for part in command], capture_output=True, text=True,
                            **options)
    if result.returncode != 0:
        raise AssertionError(f"{command}\n{result.stdout}\n{result.stderr}")
    return result.stdout


class Install(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="faultline_install_")
        cls.prefix = pathlib.Path(cls.folder.name, "prefix")
        run(CMAKE, "--install", BUILD, "--prefix", cls.prefix)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def build(self, source, name):
        build = pathlib.Path(self.folder.name, name)
        run(CMAKE, "-S", source, "-B", build, "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={self.prefix}")
        run(CMAKE, "--build", build)
        return build / name

    def test_the_example_reads_signals_from_a_bus(self):
        source = ROOT / "examples" / "can_signals"
        self.assertLessEqual(len((source / "main.cpp").read_text().splitlines()), 30)
        program = self.build(source, "can_signals")
        output = pathlib.Path(self.folder.name, "signals.txt")
        run(sys.executable, ROOT / "tools" / "with-vcan", "--", "bash", "-c", DIALOGUE, "dialogue",
            program, ROOT / "examples" / "hou2015" / "bench.dbc", output)
        self.assertEqual(set(output.read_text().splitlines()),
                         {"Sensors1.y1 = 1", "Sensors1.y2 = -1", "Sensors1.Sensors1Cycle = 42"})

    def test_a_plant_library_needs_the_installed_headers_alone(self):
        build = pathlib.Path(self.folder.name, "plant_library")
        run(CMAKE, "-S", ROOT / "examples" / "plant_library", "-B", build, "-G", "Ninja",
            f"-DFAULTLINE_INCLUDE={self.prefix}/include/faultline")
        run(CMAKE, "--build", build)
        run(self.prefix / "bin" / "faultline", "linearise", "--plant-lib", build / "my_plant.so")

    def test_the_diagnosis_libraries_link(self):
        source = pathlib.Path(self.folder.name, "source")
        source.mkdir()
        source.joinpath("main.cpp").write_text(USES_DIAGNOSIS)
        source.joinpath("CMakeLists.txt").write_text(CMAKE_LISTS)
        program = self.build(source, "uses_diagnosis")
        run(program, ROOT / "examples" / "hou2015" / "bank.toml")

    def test_the_solver_reads_no_parameters_from_its_folder(self):
        source = pathlib.Path(self.folder.name, "uses_solver_source")
        source.mkdir()
        source.joinpath("main.cpp").write_text(USES_SOLVER)
        source.joinpath("CMakeLists.txt").write_text(
            CMAKE_LISTS.replace("uses_diagnosis", "uses_solver"))
        program = self.build(source, "uses_solver")
        folder = pathlib.Path(self.folder.name, "hostile")
        folder.mkdir()
        expected = run(program, cwd=folder)
        self.assertTrue(expected.startswith("0 "), expected)
        folder.joinpath("param.csdp").write_text(HOSTILE_PARAMETERS)
        self.assertEqual(run(program, cwd=folder), expected)

    def test_every_header_stands_alone(self):
        headers = sorted(file.relative_to(self.prefix / "include" / "faultline")
                         for file in self.prefix.rglob("*.h"))
        self.assertGreater(len(headers), 30)
        source = pathlib.Path(self.folder.name, "headers.cpp")
        for header in headers:
            # Twice: each header must also bear to be included again.
            source.write_text(f'#include "{header}"\n#include "{header}"\n')
            with self.subTest(header):
                run(os.environ["CXX"], "-std=c++20", "-fsyntax-only", "-march=x86-64-v3", "-I",
                    self.prefix / "include" / "faultline", "-isystem", "/usr/include/eigen3", source)

    def test_the_installed_program_runs(self):
        self.assertIn("faultline", run(self.prefix / "bin" / "faultline", "--version"))

    def test_no_installed_file_names_the_source_tree(self):
        for file in self.prefix.rglob("*.cmake"):
            self.assertNotIn(str(ROOT), file.read_text(), file)


if __name__ == "__main__":
    sys.exit(unittest.main())
