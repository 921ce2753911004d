#!/usr/bin/python3
"""`faultline linearise`, and that the plant files of the examples are what it writes."""
import os
import re
import unittest

from faultline_program import ROOT, FolderTest

# Between machines: the mathematics library may round otherwise, and differences over 5e-5 sizes make 1e-11 of that.
TOLERANCE = 1e-9
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")


def numbers_and_text(plant_file):
    """What a plant file says beside its comments: its numbers, and the text between them."""
    text = "\n".join(line for line in plant_file.splitlines() if not line.startswith("#"))
    return [float(number) for number in NUMBER.findall(text)], NUMBER.sub("§", text)


class Linearise(FolderTest):
    def linearise(self, *arguments):
        return self.folder.run("linearise", *arguments)

    def test_the_plant_files_of_the_examples_are_what_it_writes(self):
        for plant in ("three_tank", "azimuth_vessel", "electric_car"):
            with self.subTest(plant):
                with open(f"{ROOT}/examples/{plant}/plant.toml", encoding="utf-8") as file:
                    written = file.read()
                command = re.search(r"^# Made by faultline (linearise .*)$", written, re.MULTILINE).group(1).split()
                answer = self.folder.run(*command)
                self.assertEqual(answer.code, 0, answer)
                found, found_text = numbers_and_text(answer.out)
                expected, expected_text = numbers_and_text(written)
                self.assertEqual(found_text, expected_text)
                self.assertGreater(len(found), 50)
                for mine, theirs in zip(found, expected, strict=True):
                    self.assertLessEqual(abs(mine - theirs), TOLERANCE * abs(theirs), (mine, theirs))

    def test_writes_a_file_that_the_others_read(self):
        answer = self.linearise("three_tank", "-o", "tank.toml")
        self.assertEqual((answer.code, answer.out, answer.err), (0, "", ""))
        answer = self.folder.run("info", "tank.toml")
        self.assertEqual(answer.code, 0, answer)
        self.assertIn("three_tank", answer.out)

    def test_lists_the_plants_that_ship(self):
        answer = self.linearise("--list")
        self.assertEqual(answer.code, 0, answer)
        for plant in ("hou2015", "flexible_joint", "three_tank", "azimuth_vessel", "electric_car"):
            self.assertRegex(answer.out, rf"(?m)^{plant} ")

    def test_holds_what_it_is_told_to(self):
        answer = self.linearise("three_tank", "--hold", "h1=45", "h2=25")
        self.assertEqual(answer.code, 0, answer)
        self.assertRegex(answer.out, r"(?m)^x = \[45, 25, 3\d\.")
        self.assertIn("# Made by faultline linearise three_tank --hold h1=45 h2=25\n", answer.out)

    def test_takes_other_parameters(self):
        answer = self.linearise("three_tank", "--set", "leak3=2")
        self.assertEqual(answer.code, 0, answer)
        self.assertNotEqual(numbers_and_text(answer.out)[0], numbers_and_text(self.linearise("three_tank").out)[0])

    def test_warns_of_what_is_doubtful(self):
        self.assertIn("unstable there: eigenvalues with real part", self.linearise("hou2015").err)
        self.assertIn("the equations have a kink near", self.linearise("azimuth_vessel").err)

    def test_says_that_there_is_no_equilibrium(self):
        # Nothing fills tank 3 but tank 1: it cannot stand above both others.
        answer = self.linearise("three_tank", "--hold", "h1=20", "h2=20", "h3=40", "-o", "tank.toml")
        self.assertEqual(answer.code, 1, answer)
        self.assertRegex(answer.err, r'plant "three_tank": found no equilibrium near the nominal point: .*h3 \(')
        self.assertNotIn("tank.toml", self.folder_names())

    def folder_names(self):
        return os.listdir(self.folder.path)

    def test_refuses_what_it_cannot_understand(self):
        for arguments, text in (
                (["three_tnak"], 'did you mean "three_tank"?'),
                ([], "found neither PLANT nor --plant-lib, expected either"),
                (["three_tank", "--plant-lib", "my.so"], "found PLANT and --plant-lib, expected either"),
                (["--plant-lib", "my.so"], "my.so: found no file, expected a shared library"),
                (["three_tank", "--hold", "h4=1"], 'hold: found "h4", expected a state or an input'),
                (["three_tank", "--hold", "h1"], '--hold: found "h1", expected NAME=NUMBER'),
                (["three_tank", "--hold", "h1=nan"], '--hold: found "h1=nan", expected NAME=NUMBER'),
                (["three_tank", "--hold", "h1=1", "h1=2"], '--hold: found "h1" twice, expected it once'),
                (["three_tank", "--set", "leek1=1"], 'did you mean "leak1"?'),
                (["three_tank", "--set", "=1"], '--set: found "=1", expected NAME=NUMBER')):
            with self.subTest(arguments):
                answer = self.linearise(*arguments)
                self.assertEqual(answer.code, 2, answer)
                self.assertIn(text, answer.err)
                self.assertEqual(answer.out, "")


if __name__ == "__main__":
    unittest.main()
