#!/usr/bin/python3
"""A plant of the user's own: built outside the tree, linearised, designed for, run; and every way in which its library
can be wrong.

CMAKE and CXX name the programs that build it (ctest sets them).
"""
import os
import shutil
import subprocess
import tempfile
import unittest

from faultline_program import ROOT, Folder

EXAMPLE = f"{ROOT}/examples/plant_library"
CMAKE, CXX = os.environ.get("CMAKE", "cmake"), os.environ.get("CXX", "c++")

# The example's tank with room for something else.
TABLE = """
#include <cmath>
#include <stdexcept>
#include "sim/plant_table.h"
{before}
static const faultline_plant_signal h[] = {{{{{state}, "cm", {nominal}, 5}}}};
static const faultline_plant_signal u[] = {{{{"pump", "ml/s", 48.5, {size}}}}};
static const faultline_plant_signal y[] = {{{{"level", "cm", 0, 5}}, {{"drain", "ml/s", 0, 5}}}};
static const faultline_plant_signal p[] = {{{{"leak", "mm2", 0, 1}}}};
static const faultline_plant_signal d[] = {{{{"inflow", "ml/s", 0, 1}}, {{"hum", "cm", 0, 1}}, {{"ripple", "ml/s", 0, 1}}}};
static void f(const double* x, const double* u, const double* p, const double*, double* dx) {{ {derivative} }}
static void g(const double* x, const double*, const double*, const double*, double* y) {{ {measure} }}
static void events(const double* x, const double*, const double*, const double*, double* g) {{ g[0] = x[0] - 20; }}
static void on_event(size_t, const double*, const double*, const double*, double* x) {{ {event} }}
static const faultline_plant_table table = {{{version}, {bytes}, "my_tank", "", "", {states}, 1, 2, 1, 3, {state_list}, u, y,
                                            p, d, {function}, g, 1, events, on_event}};
extern "C" const faultline_plant_table* {entry}(void) {{ {answer} }}
"""
RIGHT = {"before": "", "state": '"h"', "nominal": "30", "size": "30", "derivative": "dx[0] = (u[0] - 1.617 * x[0]) / 154;",
         "measure": "y[0] = y[1] = x[0];", "event": "", "version": "FAULTLINE_PLANT_VERSION", "bytes": "sizeof table",
         "states": "1", "state_list": "h", "function": "f", "entry": "faultline_plant_v1", "answer": "return &table;"}


class PlantLibrary(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.cache = tempfile.mkdtemp(prefix="faultline-test-cache.")
        cls.addClassCleanup(shutil.rmtree, cls.cache)
        cls.example = Folder(cls.cache)
        cls.addClassCleanup(cls.example.remove)
        cls.copy(cls.example)
        build = cls.example.file("build")
        subprocess.run([CMAKE, "-S", cls.example.path, "-B", build, f"-DFAULTLINE_INCLUDE={ROOT}",
                        f"-DCMAKE_CXX_COMPILER={CXX}"], check=True, capture_output=True)
        subprocess.run([CMAKE, "--build", build], check=True, capture_output=True)

    @staticmethod
    def copy(folder):
        for file in os.listdir(folder.path):
            os.remove(folder.file(file))
        for file in os.listdir(EXAMPLE):
            if os.path.isfile(f"{EXAMPLE}/{file}"):
                shutil.copy(f"{EXAMPLE}/{file}", folder.path)

    def setUp(self):
        self.folder = Folder(self.cache)
        self.addCleanup(self.folder.remove)
        self.copy(self.folder)
        os.mkdir(self.folder.file("build"))

    def build(self, **changes):
        """A library that differs from the right one in `changes`, where the scenarios look for it."""
        self.folder.write("plant.cpp", TABLE.format(**{**RIGHT, **changes}))
        subprocess.run([CXX, "-std=c++20", "-shared", "-fPIC", f"-I{ROOT}", self.folder.file("plant.cpp"), "-o",
                        self.folder.file("build/my_plant.so")], check=True)

    def assert_refused(self, *texts):
        """By everything that loads it, and nothing written."""
        before = sorted(os.listdir(self.folder.path))
        for command in (["linearise", "--plant-lib", "build/my_plant.so", "-o", "new.toml"], ["run", "healthy.toml"],
                        ["run", "healthy.toml", "--plant-lib", "build/my_plant.so"]):
            answer = self.folder.run(*command)
            self.assertEqual(answer.code, 2, answer)
            for text in ("my_plant.so: ", *texts):
                self.assertIn(text, answer.err)
        self.assertEqual(sorted(os.listdir(self.folder.path)), before)

    def assert_stopped(self, *texts):
        """A run that began, and ended for what the plant did."""
        answer = self.folder.run("run", "healthy.toml", "--no-log")
        self.assertEqual(answer.code, 1, answer)
        for text in texts:
            self.assertIn(text, answer.out + answer.err)
        return answer

    def test_its_plant_file_is_what_linearise_writes(self):
        answer = self.example.run("linearise", "--plant-lib", "build/my_plant.so")
        self.assertEqual(answer.code, 0, answer)
        self.assertEqual(answer.err, "")
        self.assertEqual(answer.out, self.example.read("plant.toml").decode())

    def test_its_scenarios_are_answered_as_they_expect(self):
        answer = self.example.run("run", ".")
        self.assertEqual(answer.code, 0, answer)
        self.assertIn("2 scenarios: 2 met", answer.out)

    def test_the_option_takes_the_place_of_what_the_scenario_names(self):
        shutil.copy(self.example.file("build/my_plant.so"), self.folder.file("other.so"))
        self.assertEqual(self.folder.run("run", "leak.toml").code, 2)
        answer = self.folder.run("run", "leak.toml", "--plant-lib", "other.so")
        self.assertEqual(answer.code, 0, answer)

    def test_the_library_that_the_errors_are_made_from_is_right(self):
        self.build()
        answer = self.folder.run("linearise", "--plant-lib", "build/my_plant.so")
        self.assertEqual(answer.code, 0, answer)

    def test_no_file(self):
        self.assert_refused("found no file, expected a shared library")

    def test_no_library(self):
        self.folder.write("build/my_plant.so", "a text")
        self.assert_refused("cannot be loaded, expected a shared library")

    def test_a_library_that_misses_a_symbol(self):
        self.build(before="extern double missing(double);", measure="y[0] = y[1] = missing(x[0]);")
        self.assert_refused("cannot be loaded", "missing")

    def test_no_entry_point(self):
        self.build(entry="my_plant")
        self.assert_refused("found no function faultline_plant_v1")

    def test_another_version(self):
        self.build(version="7")
        self.assert_refused("version: found 7, expected 1")

    def test_another_size(self):
        self.build(bytes="64")
        self.assert_refused("size: found 64 bytes, expected")

    def test_no_table(self):
        self.build(answer="return nullptr;")
        self.assert_refused("faultline_plant_v1 returned a null pointer, expected a table")

    def test_an_entry_point_that_throws(self):
        self.build(answer='throw std::runtime_error("no licence");')
        self.assert_refused('faultline_plant_v1 has thrown "no licence", expected a table')

    def test_no_function(self):
        self.build(function="nullptr")
        self.assert_refused("derivative: found a null pointer")

    def test_no_states(self):
        self.build(states="0")
        self.assert_refused("states: found none, expected at least one")

    def test_a_list_that_is_not_there(self):
        self.build(state_list="nullptr")
        self.assert_refused("states: found a null pointer, expected 1 of them")

    def test_a_state_without_a_name(self):
        self.build(state='""')
        self.assert_refused("states: found no name at place 1, expected one")

    def test_a_size_that_is_not_positive(self):
        self.build(size="0")
        self.assert_refused('inputs: found size 0 of "pump", expected a positive number')

    def test_a_number_that_is_none(self):
        self.build(nominal="NAN")
        self.assert_refused("states: found nominal nan")

    def test_a_plant_file_of_another_plant(self):
        self.build(state='"height"')
        answer = self.folder.run("run", "healthy.toml")
        self.assertEqual(answer.code, 2, answer)
        self.assertIn('states: found "h", expected one of plant "my_tank" (height)', answer.err)

    def test_equations_that_throw(self):
        for function, name in (("derivative", "derivative"), ("measure", "measure")):
            with self.subTest(function):
                self.build(**{function: 'throw std::runtime_error("h is out of the table");'})
                answer = self.folder.run("linearise", "--plant-lib", "build/my_plant.so", "-o", "new.toml")
                self.assertEqual(answer.code, 1, answer)
                self.assertIn(f'its function `{name}` has thrown "h is out of the table"', answer.err)
                self.assertFalse(os.path.exists(self.folder.file("new.toml")))
                self.assert_stopped("at t = 0 s", 'its equations have thrown "h is out of the table"')
        self.build(derivative="throw 5;")
        self.assert_stopped('its equations have thrown "an exception that is no std::exception"')

    def test_a_plant_that_diverges(self):
        # h' = (h / 30)², h(0) = 30: infinite at 30 s.
        self.build(derivative="dx[0] = x[0] * x[0] / 900;")
        self.folder.patch("healthy.toml", ("[simulation]\n", '[simulation]\nmethod = "dormand_prince"\n'))
        answer = self.assert_stopped("h: the integrator's steps became too small")
        self.assertRegex(answer.out, r"STOPPED: the plant diverged: at t = (29|30) s h: .* s into the sample")
        self.folder.patch("healthy.toml", ("dormand_prince", "rk4"))
        self.assertRegex(self.assert_stopped().out, r"STOPPED: the plant diverged: at t = 3\d s h is not finite")

    def test_a_plant_that_an_event_brings_to_rest(self):
        # A weight that the pump's force holds on a soft spring; when that force leaves it, it falls 10 cm to a stop on
        # which it bounces: at rest about √(2 10 / 48.5) (1 + 2 0.5 / (1 - 0.5)) = 1.9 s later.
        self.build(state='"h", "cm", 30, 5}, {"v"', nominal="0", states="2", measure="y[0] = x[0]; y[1] = x[1];",
                   derivative="dx[0] = x[1]; dx[1] = u[0] - 48.5 - 1e-4 * (x[0] - 30) - 0.01 * p[0];",
                   event="x[1] *= -0.5;")
        self.assertEqual(self.folder.run("linearise", "--plant-lib", "build/my_plant.so", "-o", "plant.toml").code, 0)
        self.folder.patch("bank.toml", ("poles         = [-0.05]", "decay_rate_per_s = 0.05"))
        text = self.folder.read("leak.toml").decode()
        text = text[:text.index("[[disturbance]]")].replace("[[0.01]]", "[[1e6]]") + """
[[fault]]
target = "pump"
kind   = "stuck"
at_s   = 20.0
value  = 0.0
"""
        self.folder.write("rest.toml", text)
        for method in ("rk4", "dormand_prince"):
            self.folder.write("rest.toml", text.replace("[simulation]\n", f'[simulation]\nmethod = "{method}"\n'))
            answer = self.folder.run("run", "rest.toml", "--no-log")
            self.assertEqual(answer.code, 1, answer)
            self.assertRegex(answer.out, r"STOPPED: .*at t = 2[12] s h: event 1 has brought it to rest 0\.\d+ s into")

    def test_another_plant_than_the_one_designed_for_is_found_out(self):
        # The plant on the bench is not the one that was designed for: half the drain.
        self.build(derivative="dx[0] = (u[0] - 0.8 * x[0]) / 154;")
        self.assertEqual(self.folder.run("run", "healthy.toml", "--no-log").code, 1)


if __name__ == "__main__":
    unittest.main()
