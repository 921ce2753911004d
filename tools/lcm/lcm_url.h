#pragma once

#include <string>
#include <string_view>

namespace faultline {

/// Checks an LCM URL before liblcm sees it, which takes an unknown option, a port of letters or a
/// group that is none with a remark at most:
///
///   udpm://GROUP:PORT?ttl=N&recv_buf_size=N    multicast; GROUP and PORT may be left out
///   mpudpm://..                                the same over several ports
///   tcpq://HOST:PORT                           a relay
///   memq://                                    within one process
///   file://FILE                                a log
///
/// @throws std::invalid_argument it is none of these: what was found, what was expected.
void check_lcm_url(std::string_view url);

/// The same for what is to be listened to: memq:// and file:// have no other end to listen to.
void check_live_lcm_url(std::string_view url);

/// Whether both name the same place, whatever their options.
/// @pre both passed check_lcm_url
[[nodiscard]] bool is_same_lcm_place(std::string_view a, std::string_view b);

/// Why liblcm may have refused a URL that is well-formed, and what to do.
[[nodiscard]] std::string lcm_refusal_text(std::string_view url);

}  // namespace faultline
