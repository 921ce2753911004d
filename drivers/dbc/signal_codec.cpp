#include "drivers/dbc/signal_codec.h"

#include <stdexcept>

namespace faultline {

SignalCodec::SignalCodec(const DbcSignal& signal) {
  for (const std::string& fault : {layout_fault(signal), value_fault(signal)}) {
    if (!fault.empty()) throw std::invalid_argument("signal " + signal.name + ": " + fault);
  }
  signal_ = compile_signal(signal);
}

CodecStatus SignalCodec::decode_raw(std::span<const std::uint8_t> payload,
                                    std::int64_t& raw) const noexcept {
  if (!signal_.fits_in(payload)) return CodecStatus::kPayloadTooShort;
  raw = signal_.sign_extended(signal_.read(payload));
  return CodecStatus::kOk;
}

CodecStatus SignalCodec::decode_physical(std::span<const std::uint8_t> payload,
                                         double& physical) const noexcept {
  if (!signal_.fits_in(payload)) return CodecStatus::kPayloadTooShort;
  const double value = signal_.to_physical(signal_.read(payload));
  if (!std::isfinite(value)) return CodecStatus::kNotANumber;
  physical = value;
  return CodecStatus::kOk;
}

CodecStatus SignalCodec::encode_raw(std::span<std::uint8_t> payload,
                                    std::int64_t raw) const noexcept {
  if (!signal_.fits_in(payload)) return CodecStatus::kPayloadTooShort;
  signal_.write(payload, static_cast<std::uint64_t>(raw) & signal_.mask);
  return CodecStatus::kOk;
}

CodecStatus SignalCodec::encode_physical(std::span<std::uint8_t> payload,
                                         double physical) const noexcept {
  if (!signal_.fits_in(payload)) return CodecStatus::kPayloadTooShort;
  std::uint64_t bits = 0;
  const CompiledSignal::Fit fit = signal_.to_bits(physical, bits);
  if (fit == CompiledSignal::Fit::kNotANumber) return CodecStatus::kNotANumber;
  signal_.write(payload, bits);
  return fit == CompiledSignal::Fit::kFits ? CodecStatus::kOk : CodecStatus::kOutOfRange;
}

}  // namespace faultline
