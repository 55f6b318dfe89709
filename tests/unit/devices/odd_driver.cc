// Drivers for the loader's tests; what is odd about each comes from CMake.
#include "alhazen/driver.h"

#ifndef ODD_ABI
#define ODD_ABI alhazen::kDriverAbi
#endif
#ifndef ODD_BUILD
#define ODD_BUILD ALHAZEN_DRIVER_BUILD
#endif

/// Of the test: how many modules have run code. Absent in other programs.
extern "C" __attribute__((weak)) int odd_drivers_begun;

namespace {
__attribute__((constructor)) void begin() {
  if (&odd_drivers_begun != nullptr) ++odd_drivers_begun;
}
}  // namespace

#ifdef ODD_NO_ENTRY
extern "C" __attribute__((visibility("default"))) int odd_driver_something_else;
int odd_driver_something_else = 1;
#else
namespace {

alhazen::Result<std::unique_ptr<alhazen::Driver> > open(const alhazen::Host&,
                                                        const alhazen::Settings&) noexcept {
  return alhazen::Error{alhazen::Code::unsupported, "an odd driver opens nothing"};
}

}  // namespace

extern "C" __attribute__((
    visibility("default"))) constinit const AlhazenDriverEntry alhazen_driver_entry = {
    ODD_ABI, ODD_BUILD, ODD_NAME, "a driver for tests", false, open};
#endif
