// Fuzz target: what a viewer of the live page may send, and the headers it comes with. A message is
// refused with a reason or is a request that the bench can be given; no header lets anybody in who
// does not name the token, a numeric host and our port.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "tools/dashboard/viewer_access.h"
#include "tools/dashboard/viewer_request.h"

namespace {

using namespace faultline;

void require(bool holds) {
  if (!holds) std::abort();
}

bool has_control(const std::string& text) {
  for (const char letter : text) {
    if (static_cast<unsigned char>(letter) < 0x20 || letter == 0x7f) return true;
  }
  return false;
}

void try_message(std::string_view text) {
  try {
    const inject_t request = parse_viewer_request(text);
    require(text.size() <= kLongestRequest && text.find('\0') == std::string_view::npos);
    require(request.target.size() <= 256 && request.kind.size() <= 256);
    require(!has_control(request.target) && !has_control(request.kind));
    require(request.clear != 0 || (!request.target.empty() && !request.kind.empty()));
    require(request.has_value == 0 || std::isfinite(request.value));
  } catch (const ViewerRequestError& error) {
    require(*error.what() != '\0');
  }
}

void try_headers(std::string_view text) {
  const ViewerAccess access{.token = "sesame", .port = 8080};
  if (access.admits_target(text)) require(text.find("token=sesame") != std::string_view::npos);
  if (access.admits_host(text)) {
    require(text.find("8080") != std::string_view::npos);
    require(text.find('\0') == std::string_view::npos);
  }
  if (ViewerAccess::admits_origin(text, "127.0.0.1:8080")) {
    require(text == "http://127.0.0.1:8080");
  }
  require(is_same_secret(text, access.token) == (text == access.token));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try_message(text);
  try_headers(text);
  return 0;
}
