// A host's link with its memory, and its received messages in batches: no thread, no port, no clock.
#include "wirebond/engine/link_core.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

namespace wirebond::engine {

LinkCore::LinkCore(LinkSetup setup, std::uint64_t now_us)
    : setup_(std::move(setup)),
      workspace_(workspace_bytes(setup_.receive->source())),
      queue_bytes_(max_queued_bytes),
      // The queue reserves one place for each message's repeated value.
      queue_frames_(new QueuedFrame[max_queued_frames + setup_.every_us.size() + setup_.more_addresses]),
      values_(setup_.every_us.size() + setup_.more_addresses),
      leaving_(setup_.largest_frame),
      together_(max_together_bytes),
      counts_(setup_.protocol->messages().size(), 0),
      sent_(setup_.every_us.size(), 0),
      sequence_(setup_.receive),
      recent_(setup_.recent_bytes) {
  for (std::size_t i = 0; i < setup_.every_us.size(); ++i) {
    const bool keeps_latest = setup_.keeps_latest.at(i);
    if (setup_.every_us[i] != 0 || keeps_latest) values_[i].resize(setup_.largest_frame);
    leases_.emplace_back(setup_.every_us[i], values_[i].data(), values_[i].size(), keeps_latest);
  }
  for (std::size_t i = setup_.every_us.size(); i < values_.size(); ++i) {
    values_[i].resize(setup_.largest_frame);
    leases_.emplace_back(0, values_[i].data(), values_[i].size());
  }
  for (const StopFrame& stop : setup_.stop) {
    safe_values_.emplace_back(stop.message, stop.address, stop.frame.data(), stop.frame.size(), stop.reply,
                              stop.every_us, stop.is_in_stop);
  }
  safe_values_.resize(setup_.stop.size() + (setup_.stop.empty() ? 0 : setup_.more_addresses));
  const FrameFormat& sent = setup_.send->format();
  if (sequence_mask(sent) != 0) {
    next_numbers_.resize(sent.sequence_per_message ? setup_.protocol->messages().size() : 1);
    numbering_.resize(FrameNumbers::scratch_bytes(sent));
    numbers_ = std::make_unique<FrameNumbers>(setup_.send->source(),
                                              FrameNumbers::Memory{next_numbers_.data(), numbering_.data()});
    leaving_.resize(std::max(leaving_.size(), max_wire_bytes(sent)));
  }
  deadline_since_.resize(setup_.deadlines.size());
  deadline_marks_.resize(setup_.deadlines.size());
  deadline_struck_.resize(setup_.deadlines.size());

  HostLink::Memory memory;
  memory.workspace = workspace_.data();
  memory.outbox.bytes = queue_bytes_.data();
  memory.outbox.byte_capacity = queue_bytes_.size();
  memory.outbox.frames = queue_frames_.get();
  memory.outbox.frame_capacity = max_queued_frames + leases_.size();
  memory.outbox.leases = leases_.data();
  memory.outbox.lease_count = leases_.size();
  memory.outbox.message_count = setup_.every_us.size();
  memory.outbox.safe_values = safe_values_.data();
  memory.outbox.safe_count = setup_.stop.size();
  memory.outbox.safe_capacity = safe_values_.size();
  memory.outbox.leaving = leaving_.data();
  memory.outbox.leaving_capacity = leaving_.size();
  memory.outbox.together = together_.data();
  memory.outbox.together_capacity = together_.size();
  memory.outbox.numbers = numbers_.get();
  memory.outbox.sent_by_message = sent_.data();
  memory.deadlines = {setup_.deadlines.data(), setup_.deadlines.size(), deadline_since_.data(), deadline_marks_.data()};
  HostLink::Settings settings;
  settings.pacing = setup_.pacing;
  settings.idle_us = setup_.idle_us;
  settings.pause_us = setup_.pause_us;
  settings.max_age_us = setup_.max_age_us;
  settings.addressing = setup_.addressing;
  for (const StopPayload& stop : setup_.peer_stops) {
    peer_stops_.push_back({stop.message, stop.payload.data(), stop.mask.data(), stop.mask.size(), stop.is_whole});
  }
  settings.peer_stops = peer_stops_.data();
  settings.peer_stop_count = peer_stops_.size();
  link_ = std::make_unique<HostLink>(setup_.receive->source(), memory, settings, now_us);
  if (setup_.echoes) {
    std::size_t size = 4096;
    while (size < 4 * (setup_.largest_frame + Echo::piece_overhead)) size *= 2;
    echo_memory_.resize(size);
    echo_ = std::make_unique<HostEcho>(echo_memory_.data(), size, setup_.idle_us + scheduling_us);
  }
}

void LinkCore::received(const std::uint8_t* bytes, std::size_t size, std::uint64_t before_us, std::uint64_t after_us,
                        bool is_all) {
  if (echo_ == nullptr) return take_received(bytes, size, before_us, after_us, is_all);
  others_.clear();
  echo_->hear(bytes, size, after_us, [this](const std::uint8_t* from, std::size_t count) {
    others_.insert(others_.end(), from, from + count);
  });
  note_collisions(after_us);
  if (!others_.empty()) return take_received(others_.data(), others_.size(), before_us, after_us, is_all);
  if (is_all) idle(before_us);  // no other end sent anything
}

void LinkCore::give_up_echo(std::uint64_t now_us) {
  others_.clear();
  echo_->give_up(
      [this](const std::uint8_t* from, std::size_t count) { others_.insert(others_.end(), from, from + count); });
  note_collisions(now_us);
  const std::uint64_t came_us = echo_->since_us();
  if (!others_.empty()) take_received(others_.data(), others_.size(), came_us, came_us, false);
}

struct LinkCore::Keeping {
  LinkCore& core;
  std::uint64_t when_us;
  Arrivals arrivals{};

  void operator()(const Frame& frame, MayAct may_act, bool is_foreign) {
    const LinkSetup& setup = core.setup_;
    if (frame.message >= 0) ++core.counts_[static_cast<std::size_t>(frame.message)];
    core.sequence_.take(frame);
    if (is_foreign) return core.foreign_.add(frame);
    if ((may_act == MayAct::late || may_act == MayAct::held_back) && setup.holds_back) return;
    if (arrivals.batch == nullptr) {
      arrivals.batch = std::make_shared<Batch>();
      arrivals.batch->protocol = setup.protocol;
      arrivals.batch->format = setup.receive;
    }
    arrivals.events.push_back(record(frame, static_cast<double>(when_us) * 1e-6, *arrivals.batch));
  }
};

void LinkCore::note_collisions(std::uint64_t now_us) {
  for (; noted_collisions_ != echo_->collisions(); ++noted_collisions_) {
    recent_.note(RecentKind::collision, nullptr, 0, now_us);
  }
}

std::uint64_t LinkCore::next_due(std::uint64_t now_us) const {
  const std::uint64_t due = link_->next_due(now_us);
  return echo_ == nullptr ? due : std::min(due, std::max(echo_->due_us(), now_us));
}

void LinkCore::take_received(const std::uint8_t* bytes, std::size_t size, std::uint64_t before_us,
                             std::uint64_t after_us, bool is_all) {
  recent_.note(RecentKind::received, bytes, size, after_us);
  tap(TapKind::received, bytes, size, before_us, after_us);
  Keeping sink{*this, before_us};
  link_->received(bytes, size, before_us, after_us, is_all, sink);
  publish(std::move(sink.arrivals));
  note_changes(after_us);
  tell_deadlines(after_us);
}

void LinkCore::idle(std::uint64_t began_us) {
  if (echo_ != nullptr && echo_->holds()) return;  // bytes came
  Keeping sink{*this, began_us};
  link_->idle(began_us, sink);
  publish(std::move(sink.arrivals));
  tell_deadlines(began_us);
}

void LinkCore::poll(std::uint64_t now_us) {
  note_changes(now_us);
  if (echo_ != nullptr && now_us >= echo_->due_us()) give_up_echo(now_us);
  link_->poll(now_us);
  note_changes(now_us, "expired");
  tell_deadlines(now_us);
}

void LinkCore::recover_deadline(std::uint8_t action, std::uint64_t now_us) {
  link_->deadlines().recover(action, now_us);
  note_changes(now_us);
  tell_deadlines(now_us);
}

/// Report the actions that have struck or ended since the last call.
void LinkCore::tell_deadlines(std::uint64_t now_us) {
  for (std::size_t i = 0; i < setup_.deadlines.size(); ++i) {
    const std::uint8_t action = setup_.deadlines[i].action;
    const std::uint8_t has_struck = link_->deadlines().struck(action);
    if (deadline_struck_[i] == has_struck) continue;
    for (std::size_t j = i; j < setup_.deadlines.size(); ++j) {  // several deadlines may have one action
      if (setup_.deadlines[j].action == action) deadline_struck_[j] = has_struck;
    }
    tell({now_us, has_struck != 0 ? ChangeKind::struck : ChangeKind::ended, action});
  }
}

void LinkCore::tell(LinkChange change) {
  if (changes_.size() == max_waiting_changes) changes_.pop_front();
  changes_.push_back(change);
}

Outgoing LinkCore::to_write(std::uint64_t now_us, bool together) {
  return to_write_ = link_->to_write(now_us, together && echo_ == nullptr);
}

void LinkCore::written(std::size_t size, std::uint64_t now_us) {
  if (size != 0) {
    if (echo_ != nullptr && !is_under_way_ && !echo_->sent(to_write_.bytes, to_write_.size, now_us)) {
      give_up_echo(now_us);
      static_cast<void>(echo_->sent(to_write_.bytes, to_write_.size, now_us));  // any frame fits now
    }
    recent_.note(RecentKind::sent, to_write_.bytes, size, now_us);
    tap(TapKind::sent, to_write_.bytes, size, now_us, now_us);
    to_write_.bytes += size;
    to_write_.size -= size;
    is_under_way_ = to_write_.size != 0;
  }
  link_->written(size, now_us);
}

void LinkCore::port_up(std::uint64_t now_us) {
  recent_.note(RecentKind::port_up, nullptr, 0, now_us);
  tap(TapKind::port_up, nullptr, 0, now_us, now_us);
  if (was_up_) reconnects_ += 1;
  was_up_ = true;
  is_under_way_ = false;
  if (echo_ != nullptr) echo_->forget();
  link_->port_up(now_us);
  tell({now_us, ChangeKind::port_up});
}

void LinkCore::port_down(std::uint64_t now_us, const std::string& why) {
  recent_.note(RecentKind::port_down, nullptr, 0, now_us);
  if (link_->is_up()) tap_text(TapKind::port_down, why, now_us);
  Keeping sink{*this, now_us};
  link_->port_down(now_us, sink);
  publish(std::move(sink.arrivals));
  tell_deadlines(now_us);
  tell({now_us, ChangeKind::port_down});
}

int LinkCore::open_tap(std::size_t capacity, std::uint64_t now_us) {
  note_changes(now_us);
  std::vector<Tap> others = std::exchange(taps_, {});
  taps_.emplace_back(++last_tap_, capacity);
  if (link_->is_up()) tap(TapKind::port_up, nullptr, 0, now_us, now_us);
  was_stopped_ = false;  // the present state is an event for the new tap
  had_struck_.clear();
  was_repeating_.assign(leases_.size(), 0);
  note_changes(now_us);
  std::move(others.begin(), others.end(), std::back_inserter(taps_));
  return last_tap_;
}

TapCopy LinkCore::take_tap(int number) {
  for (Tap& tap : taps_) {
    if (tap.number() == number) return tap.take();
  }
  return {};
}

void LinkCore::close_tap(int number) {
  taps_.erase(std::remove_if(taps_.begin(), taps_.end(), [number](const Tap& tap) { return tap.number() == number; }),
              taps_.end());
}

void LinkCore::note(const std::string& text, std::uint64_t now_us) { tap_text(TapKind::noted, text, now_us); }

void LinkCore::settings_restored(std::uint64_t now_us) {
  recent_.note(RecentKind::settings, nullptr, 0, now_us);
  tap(TapKind::port_settings, nullptr, 0, now_us, now_us);
}

void LinkCore::compare(std::uint64_t now_us, const char* why) {
  if (const bool stopped = outbox().is_stopped(); stopped != was_stopped_) {
    tap(stopped ? TapKind::stopped : TapKind::released, nullptr, 0, now_us, now_us);
    was_stopped_ = stopped;
  }
  const std::vector<std::uint8_t> struck = struck_deadlines();
  const auto has = [](const std::vector<std::uint8_t>& in, std::uint8_t action) {
    return std::find(in.begin(), in.end(), action) != in.end();
  };
  for (const std::uint8_t action : struck) {
    if (!has(had_struck_, action)) tap(TapKind::deadline_struck, &action, 1, now_us, now_us);
  }
  for (const std::uint8_t action : had_struck_) {
    if (!has(struck, action)) tap(TapKind::deadline_ended, &action, 1, now_us, now_us);
  }
  had_struck_ = struck;
  for (std::size_t i = 0; i < leases_.size(); ++i) {
    const bool is_repeating = leases_[i].is_alive();
    if (is_repeating == (was_repeating_[i] != 0)) continue;
    was_repeating_[i] = is_repeating ? 1 : 0;
    std::string text = std::to_string(leases_[i].message()) + ' ' + std::to_string(leases_[i].address());
    if (!is_repeating) text += std::string(" ") + why;
    tap_text(is_repeating ? TapKind::lease_begun : TapKind::lease_ended, text, now_us);
  }
}

bool LinkCore::note_safe(StopFrame safe) {
  if (outbox().has_safe(safe.message, safe.address)) return true;
  safe_frames_.push_back(std::move(safe.frame));
  const std::vector<std::uint8_t>& frame = safe_frames_.back();
  return outbox().add_safe(
      SafeValue(safe.message, safe.address, frame.data(), frame.size(), safe.reply, safe.every_us, safe.is_in_stop));
}

void LinkCore::publish(Arrivals&& arrivals) {
  if (arrivals.events.empty()) return;
  waiting_messages_ += arrivals.events.size();
  arrivals_.push_back(std::move(arrivals));
  while (waiting_messages_ > max_waiting_messages && arrivals_.size() > 1) {  // the newest matter more
    waiting_messages_ -= arrivals_.front().events.size();
    dropped_messages_ += arrivals_.front().events.size();
    arrivals_.pop_front();
  }
}

std::deque<Arrivals> LinkCore::take() {
  waiting_messages_ = 0;
  return std::exchange(arrivals_, {});
}

std::vector<std::uint8_t> LinkCore::hand_over(std::uint64_t now_us) {
  const Outgoing out = to_write(now_us);
  std::vector<std::uint8_t> bytes(out.bytes, out.bytes + out.size);
  if (out.size != 0) written(std::max<std::size_t>(out.size - 1, 1), now_us);
  return bytes;
}

LinkAccount LinkCore::account() const {
  LinkAccount out;
  out.send = link_->outbox().account();
  out.receive = link_->deframer().account();
  out.bytes = link_->deframer().bytes();
  out.pending = link_->deframer().pending();
  out.counts = counts_;
  out.sent = sent_;
  out.sequence = sequence_.account();
  out.not_acted = link_->deadlines().not_acted();
  out.foreign = foreign_;
  out.dropped_messages = dropped_messages_;
  out.reconnects = reconnects_;
  if (echo_ != nullptr) {
    out.echoed = echo_->echoed();
    out.collisions = echo_->collisions();
  }
  return out;
}

std::vector<std::uint8_t> LinkCore::struck_deadlines() const {
  std::vector<std::uint8_t> out;
  for (const DeadlineRule& rule : setup_.deadlines) {
    if (link_->deadlines().struck(rule.action) && std::find(out.begin(), out.end(), rule.action) == out.end())
      out.push_back(rule.action);
  }
  return out;
}

}  // namespace wirebond::engine
