//! How many pages may be connected, by what they may do: those who watch cannot lock out who drives or conducts a study.

use crate::input_arbiter::ClientId;
use std::sync::{
    Arc, Mutex, MutexGuard, PoisonError,
    atomic::{AtomicBool, Ordering},
};
use tokio::sync::Notify;

/// What a page may do. Each kind has places of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SlotKind {
    /// Watches only.
    Watching,
    /// May drive.
    Driving,
    /// Conducts.
    Conducting,
}

/// Most pages of each kind.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SlotLimits {
    pub(crate) watching: usize,
    pub(crate) driving: usize,
    pub(crate) conducting: usize,
}

/// The pages that are connected.
#[derive(Debug)]
pub(crate) struct ClientSlots {
    limits: SlotLimits,
    /// In the order in which they came.
    occupied: Mutex<Vec<OccupiedSlot>>,
}

#[derive(Debug)]
struct OccupiedSlot {
    client: ClientId,
    kind: SlotKind,
    has_spoken: Arc<AtomicBool>,
    answers_pings: Arc<AtomicBool>,
    eviction: Arc<Notify>,
}

impl ClientSlots {
    pub(crate) fn new(seats: SlotLimits) -> Arc<ClientSlots> {
        Arc::new(ClientSlots { limits: seats, occupied: Mutex::default() })
    }

    fn occupied(&self) -> MutexGuard<'_, Vec<OccupiedSlot>> {
        // No code that holds the lock can panic half way through a change.
        self.occupied.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for `client`. If all of its kind are taken, one that only watches is refused. For one that may drive or conduct another
    /// makes room: the first of those that never said anything, else the first. Who drives keeps the place. So does a page that
    /// conducts and ever answered a ping: a browser answers by itself, also while its page rests, and a crowd must not move an
    /// experimenter who looks on. If all that conduct answer, the new one is refused.
    ///
    /// # Errors
    /// How many pages of that kind are connected already.
    pub(crate) fn acquire(
        self: &Arc<Self>,
        client: ClientId,
        seat: SlotKind,
        driver: Option<ClientId>,
    ) -> Result<ClientSlot, usize> {
        let mut held = self.occupied();
        let max_clients = match seat {
            SlotKind::Watching => self.limits.watching,
            SlotKind::Driving => self.limits.driving,
            SlotKind::Conducting => self.limits.conducting,
        };
        if held.iter().filter(|held| held.kind == seat).count() >= max_clients {
            let goes = |held: &OccupiedSlot| {
                let keeps = seat == SlotKind::Conducting && held.answers_pings.load(Ordering::Relaxed);
                held.kind == seat && Some(held.client) != driver && !keeps
            };
            let silent = held.iter().position(|held| goes(held) && !held.has_spoken.load(Ordering::Relaxed));
            let oldest = silent.or_else(|| held.iter().position(goes));
            let oldest = oldest.filter(|_| seat != SlotKind::Watching).ok_or(max_clients)?;
            held.remove(oldest).eviction.notify_one();
        }
        let slot = ClientSlot {
            client,
            has_spoken: Arc::default(),
            answers_pings: Arc::default(),
            eviction: Arc::default(),
            slots: Arc::clone(self),
        };
        let ClientSlot { has_spoken: spoke, answers_pings: answers, eviction: lost, .. } = &slot;
        let (spoke, answers, lost) = (Arc::clone(spoke), Arc::clone(answers), Arc::clone(lost));
        held.push(OccupiedSlot {
            client,
            kind: seat,
            has_spoken: spoke,
            answers_pings: answers,
            eviction: lost,
        });
        Ok(slot)
    }
}

/// A page's place, until it is dropped.
#[derive(Debug)]
pub(crate) struct ClientSlot {
    pub(crate) client: ClientId,
    has_spoken: Arc<AtomicBool>,
    answers_pings: Arc<AtomicBool>,
    eviction: Arc<Notify>,
    slots: Arc<ClientSlots>,
}

impl ClientSlot {
    /// The page said something of sense.
    pub(crate) fn mark_active(&self) {
        self.has_spoken.store(true, Ordering::Relaxed);
    }

    /// The page answered a ping. One that stops answering loses its connection, and with it its place, by
    /// [`Pulse`](proact_http::Pulse).
    pub(crate) fn mark_responsive(&self) {
        self.answers_pings.store(true, Ordering::Relaxed);
    }

    /// Until another page takes the place.
    pub(crate) async fn wait_for_eviction(&self) {
        self.eviction.notified().await;
    }
}

impl Drop for ClientSlot {
    fn drop(&mut self) {
        self.slots.occupied().retain(|held| held.client != self.client);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_its_own_places_and_the_driver_keeps_its_own() {
        let slots = ClientSlots::new(SlotLimits { watching: 2, driving: 2, conducting: 1 });
        let enter = |client, seat| slots.acquire(client, seat, Some(3));
        let clients = || slots.occupied().iter().map(|held| held.client).collect::<Vec<_>>();
        let watching: Vec<_> = [1, 2].map(|client| enter(client, SlotKind::Watching)).into();
        assert_eq!(enter(9, SlotKind::Watching).unwrap_err(), 2);
        let driving: Vec<_> = [3, 4, 5].map(|client| enter(client, SlotKind::Driving)).into();
        assert_eq!(clients(), [1, 2, 3, 5], "4 came before 5, and 3 drives");
        let conducting: Vec<_> = [6, 7].map(|client| enter(client, SlotKind::Conducting)).into();
        assert_eq!(clients(), [1, 2, 3, 5, 7]);
        drop((watching, driving, conducting));
        assert!(clients().is_empty());
    }

    #[test]
    fn pages_that_never_said_anything_make_room_first() {
        let slots = ClientSlots::new(SlotLimits { watching: 0, driving: 0, conducting: 2 });
        let enter = |client| slots.acquire(client, SlotKind::Conducting, None).unwrap();
        let clients = || slots.occupied().iter().map(|held| held.client).collect::<Vec<_>>();
        let first = enter(1);
        first.mark_active();
        let others: Vec<_> = (2..40).map(enter).collect();
        assert_eq!(clients(), [1, 39]);
        others.iter().for_each(ClientSlot::mark_active);
        let last = enter(40);
        assert_eq!(clients(), [39, 40]);
        drop((first, last));
    }

    /// 41 pages that said nothing took the place of an experimenter whose page was open.
    #[test]
    fn a_page_that_answers_pings_makes_no_room_and_a_crowd_that_answers_is_refused() {
        let slots = ClientSlots::new(SlotLimits { watching: 0, driving: 2, conducting: 3 });
        let clients = || slots.occupied().iter().map(|held| held.client).collect::<Vec<_>>();
        let enter = |client| slots.acquire(client, SlotKind::Conducting, None);
        let first = enter(1).unwrap();
        first.mark_responsive();
        let entered: Vec<_> = (2..100).map(|client| enter(client).unwrap()).collect();
        entered.iter().for_each(ClientSlot::mark_active);
        assert_eq!(clients(), [1, 98, 99]);
        entered.iter().for_each(ClientSlot::mark_responsive);
        assert_eq!(enter(100).unwrap_err(), 3);
        let driving: Vec<_> =
            (101..104).map(|client| slots.acquire(client, SlotKind::Driving, None).unwrap()).collect();
        assert_eq!(clients(), [1, 98, 99, 102, 103], "each kind has its own places");
        drop(first);
        let next = enter(104).unwrap();
        assert_eq!(clients(), [98, 99, 102, 103, 104]);
        drop((entered, driving, next));
    }
}
