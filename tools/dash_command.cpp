#include <cstdio>
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <fmt/format.h>

#include "tools/bench/stop_signal.h"
#include "tools/cli.h"
#include "tools/dashboard/dash_server.h"

namespace faultline {
namespace {

struct DashArguments {
  std::string lcm_url = "udpm://239.255.76.67:7667?ttl=0";
  std::string listen = "127.0.0.1:8080";
  std::string token;
};

int dash(const DashArguments& arguments) {
  StopSignal stop;
  DashServer server({.lcm_url = arguments.lcm_url,
                     .listen = parse_listen_address(arguments.listen),
                     .token = arguments.token});
  const std::string address = arguments.listen.substr(0, arguments.listen.rfind(':'));
  fmt::print("http://{}:{}/{}\n", address, server.port(),
             arguments.token.empty() ? "" : "?token=..");
  std::fflush(stdout);
  int signal = 0;
  server.run([&] { return (signal = stop.poll()) != 0; });
  return kExitSignal + signal;
}

}  // namespace

void add_dash_command(CLI::App& program, int& exit_code) {
  CLI::App* command = program.add_subcommand(
      "dash", "Show a running bench on a live page, and inject faults from it");
  auto arguments = std::make_shared<DashArguments>();
  command->add_option("--lcm", arguments->lcm_url, "LCM URL of the run")->capture_default_str();
  command->add_option("--listen", arguments->listen, "Address and port of the page; port 0: any")
      ->capture_default_str();
  command->add_option("--token", arguments->token,
                      "Asked of viewers (/?token=T); needed where --listen is not loopback");
  command->footer(kExitCodesHelp);
  command->callback([arguments, &exit_code] { exit_code = dash(*arguments); });
}

}  // namespace faultline
