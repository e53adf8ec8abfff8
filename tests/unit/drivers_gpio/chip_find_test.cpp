// Chips by label, lines by name, and what is said of those that are not there.
#include "drivers/gpio/chip_find.hpp"

#include <gmock/gmock.h>

#include <stdexcept>

namespace {

using drivers::gpio::ChipSeen;
using drivers::gpio::find_chip;
using drivers::gpio::GpioConfig;
using testing::HasSubstr;

const std::vector<ChipSeen> kChips{
    {"/dev/gpiochip0", "pinctrl-bcm2711", {"ID_SDA", "ID_SCL", "GPIO2", "GPIO3", "GPIO3"}},
    {"/dev/gpiochip1", "raspberrypi-exp-gpio", {"BT_ON", "", "PWR_LED"}},
    {"/dev/gpiochip2", "ftdi-cbus", {"", "", ""}},
    {"/dev/gpiochip3", "ftdi-cbus", {"STOP", "", ""}}};

GpioConfig chip_config() {
  GpioConfig c;
  c.kind = "chip";
  return c;
}

std::string refusal_of(const GpioConfig& c, const std::vector<ChipSeen>& chips = kChips) {
  try {
    return "taken: " + find_chip(c, chips).text;
  } catch (const std::runtime_error& e) {
    return e.what();
  }
}

TEST(ChipFind, ByLabelAndByName) {
  GpioConfig c = chip_config();
  c.label = "raspberrypi-exp-gpio";
  c.estop_name = "PWR_LED";
  c.lamp_line = 0;
  const auto found = find_chip(c, kChips);
  EXPECT_EQ(found.config.chip, "/dev/gpiochip1");
  EXPECT_EQ(found.config.estop_line, 2);
  EXPECT_EQ(found.config.lamp_line, 0);
  EXPECT_EQ(found.text,
            "/dev/gpiochip1 'raspberrypi-exp-gpio', emergency stop on line 2 'PWR_LED', lamp on "
            "line 0 'BT_ON'");
  EXPECT_EQ(found.config.lines().inputs, std::vector<int>{2});
}

// A file that names a chip by number is read as ever, and its label is told.
TEST(ChipFind, ByNumberItsLabelIsTold) {
  GpioConfig c = chip_config();
  c.chip = "gpiochip2";
  c.estop_line = 1;
  EXPECT_EQ(find_chip(c, kChips).text, "/dev/gpiochip2 'ftdi-cbus', emergency stop on line 1");
  c.chip = "/dev/gpiochip9";  // who opens it says that it is not there
  EXPECT_EQ(find_chip(c, kChips).config.chip, "/dev/gpiochip9");
}

TEST(ChipFind, ALabelThatDoesNotMatchStopsTheStart) {
  GpioConfig c = chip_config();
  c.label = "pinctrl-rp1";
  EXPECT_THAT(
      refusal_of(c),
      testing::AllOf(HasSubstr("robot.gpio.label = \"pinctrl-rp1\": no chip has this label"),
                     HasSubstr("/dev/gpiochip0 'pinctrl-bcm2711'")));
  EXPECT_THAT(refusal_of(c, {}), HasSubstr("none that this user may open"));
  c.label = "pinctrl-bcm2711";
  c.chip = "gpiochip1";
  EXPECT_THAT(refusal_of(c), HasSubstr("/dev/gpiochip1 has the label 'raspberrypi-exp-gpio'"));
  c.chip = "gpiochip7";
  EXPECT_THAT(refusal_of(c), HasSubstr("/dev/gpiochip7 is not there"));
  c = chip_config();
  c.label = "ftdi-cbus";
  EXPECT_THAT(refusal_of(c), HasSubstr("2 chips have this label"));
  c.chip = "gpiochip3";
  EXPECT_THAT(refusal_of(c), HasSubstr("taken: /dev/gpiochip3 'ftdi-cbus'"));
}

TEST(ChipFind, ALineThatIsNotThereIsNamedWithThoseThatAre) {
  GpioConfig c = chip_config();
  c.estop_name = "GPIO9";
  EXPECT_THAT(refusal_of(c), testing::AllOf(HasSubstr("robot.gpio.estop_name = \"GPIO9\""),
                                            HasSubstr("its lines are ID_SDA, ID_SCL, GPIO2")));
  c.estop_name = "GPIO3";
  EXPECT_THAT(refusal_of(c), HasSubstr("2 lines of /dev/gpiochip0 have this name"));
  c.estop_name = "GPIO2";
  c.enable_name = "ENABLE";
  EXPECT_THAT(refusal_of(c), HasSubstr("robot.gpio.enable_name"));
  c = chip_config();
  c.chip = "gpiochip2";
  c.estop_name = "STOP";
  EXPECT_THAT(refusal_of(c), HasSubstr("its lines have no names: give numbers"));
  c.chip = "gpiochip8";
  EXPECT_THAT(refusal_of(c), HasSubstr("/dev/gpiochip8 is not there"));
}

// Simulated lines need no chip: one that is known by its name is fitted all the same.
TEST(ChipFind, ANamedLineIsFittedInTheTwinToo) {
  GpioConfig c = chip_config();
  c.enable_name = "ENABLE";
  c.lamp_name = "LAMP";
  const auto lines = c.lines();
  EXPECT_EQ(lines.enable, 1);
  EXPECT_EQ(lines.lamp, 0);
  EXPECT_NE(lines.inputs[1], lines.outputs[0]);
}

}  // namespace
