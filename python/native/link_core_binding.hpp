// What a link has, as Python sees it.
#pragma once

#include <nanobind/nanobind.h>

#include <deque>
#include <memory>

#include "wirebond/engine/link_core.hpp"

namespace wirebond::engine {

namespace nb = nanobind;

/// Register `LinkCore` with Python, with times in microseconds as arguments, for links whose port is driven from Python
/// and for tests under virtual time.
void bind_link_core(nb::module_& m);

/// Return the setup of a link; `settings`: an `EngineSettings` of Python. Needs the GIL.
LinkSetup link_setup(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> receive,
                     nb::handle settings);

/// Return the messages in their order. With the GIL, no lock.
nb::list to_list(const std::deque<Arrivals>& taken, const nb::object& stamper);

/// Return ``[(kind, before, t, bytes), …]``, and the losses since the last time: pieces, received bytes, sent bytes.
nb::tuple to_tuple(const TapCopy& taken);

/// Return ``(kind, t, bytes)`` for each piece, times in microseconds, and how many bytes were dropped. With the GIL, no
/// lock.
nb::tuple to_tuple(const RecentCopy& recent);

/// Return ``(kind, t, action)`` for each, times in microseconds. With the GIL, no lock.
nb::list to_list(const std::deque<LinkChange>& changes);

}  // namespace wirebond::engine
