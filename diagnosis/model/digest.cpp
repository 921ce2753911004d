#include "diagnosis/model/digest.h"

#include <boost/uuid/name_generator_sha1.hpp>
#include <boost/uuid/uuid_io.hpp>

namespace faultline {
namespace {

// Drawn at random once; changing it changes every digest ever written.
constexpr boost::uuids::uuid kNamespace = {{0x7c, 0x1e, 0x52, 0x0b, 0x93, 0xd4, 0x4f, 0x6a, 0x8e,
                                            0x25, 0x30, 0xb9, 0x61, 0xfa, 0x0d, 0x48}};

}  // namespace

std::string text_digest(std::string_view text) {
  return to_string(boost::uuids::name_generator_sha1(kNamespace)(text.data(), text.size()));
}

}  // namespace faultline
