//! How many pages may be connected, by what they may do: those who watch cannot lock out who drives or conducts a study.

use crate::input_arbiter::ClientId;
use std::sync::{
    Arc, Mutex, MutexGuard, PoisonError,
    atomic::{AtomicBool, Ordering},
};
use tokio::sync::Notify;

/// What a page may do. Each kind has places of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Seat {
    /// Watches only.
    Watching,
    /// May drive.
    Driving,
    /// Conducts.
    Conducting,
}

/// Most pages of each kind.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seats {
    pub(crate) watching: usize,
    pub(crate) driving: usize,
    pub(crate) conducting: usize,
}

/// The pages that are connected.
#[derive(Debug)]
pub(crate) struct Places {
    seats: Seats,
    /// In the order in which they came.
    held: Mutex<Vec<Held>>,
}

#[derive(Debug)]
struct Held {
    client: ClientId,
    seat: Seat,
    spoke: Arc<AtomicBool>,
    lost: Arc<Notify>,
}

impl Places {
    pub(crate) fn new(seats: Seats) -> Arc<Places> {
        Arc::new(Places { seats, held: Mutex::default() })
    }

    fn held(&self) -> MutexGuard<'_, Vec<Held>> {
        // No code that holds the lock can panic half way through a change.
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for `client`. If all of its kind are taken, one that only watches is refused. For one that may drive or conduct another
    /// makes room: the one that came first of those that never said anything, else of all, but never `driver`.
    ///
    /// # Errors
    /// How many pages of that kind are connected already.
    pub(crate) fn enter(
        self: &Arc<Self>,
        client: ClientId,
        seat: Seat,
        driver: Option<ClientId>,
    ) -> Result<Place, usize> {
        let mut held = self.held();
        let most = match seat {
            Seat::Watching => self.seats.watching,
            Seat::Driving => self.seats.driving,
            Seat::Conducting => self.seats.conducting,
        };
        if held.iter().filter(|held| held.seat == seat).count() >= most {
            let goes = |held: &Held| held.seat == seat && Some(held.client) != driver;
            let silent = held.iter().position(|held| goes(held) && !held.spoke.load(Ordering::Relaxed));
            let oldest = silent.or_else(|| held.iter().position(goes));
            let oldest = oldest.filter(|_| seat != Seat::Watching).ok_or(most)?;
            held.remove(oldest).lost.notify_one();
        }
        let (spoke, lost) = (Arc::new(AtomicBool::new(false)), Arc::new(Notify::new()));
        held.push(Held { client, seat, spoke: Arc::clone(&spoke), lost: Arc::clone(&lost) });
        Ok(Place { client, spoke, lost, places: Arc::clone(self) })
    }
}

/// A page's place, until it is dropped.
#[derive(Debug)]
pub(crate) struct Place {
    pub(crate) client: ClientId,
    spoke: Arc<AtomicBool>,
    lost: Arc<Notify>,
    places: Arc<Places>,
}

impl Place {
    /// The page said something of sense.
    pub(crate) fn note_speech(&self) {
        self.spoke.store(true, Ordering::Relaxed);
    }

    /// Until another page takes the place.
    pub(crate) async fn lost(&self) {
        self.lost.notified().await;
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.places.held().retain(|held| held.client != self.client);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_its_own_places_and_the_driver_keeps_its_own() {
        let places = Places::new(Seats { watching: 2, driving: 2, conducting: 1 });
        let enter = |client, seat| places.enter(client, seat, Some(3));
        let clients = || places.held().iter().map(|held| held.client).collect::<Vec<_>>();
        let watching: Vec<_> = [1, 2].map(|client| enter(client, Seat::Watching)).into();
        assert_eq!(enter(9, Seat::Watching).unwrap_err(), 2);
        let driving: Vec<_> = [3, 4, 5].map(|client| enter(client, Seat::Driving)).into();
        assert_eq!(clients(), [1, 2, 3, 5], "4 came before 5, and 3 drives");
        let conducting: Vec<_> = [6, 7].map(|client| enter(client, Seat::Conducting)).into();
        assert_eq!(clients(), [1, 2, 3, 5, 7]);
        drop((watching, driving, conducting));
        assert!(clients().is_empty());
    }

    #[test]
    fn pages_that_never_said_anything_make_room_first() {
        let places = Places::new(Seats { watching: 0, driving: 0, conducting: 2 });
        let enter = |client| places.enter(client, Seat::Conducting, None).unwrap();
        let clients = || places.held().iter().map(|held| held.client).collect::<Vec<_>>();
        let first = enter(1);
        first.note_speech();
        let others: Vec<_> = (2..40).map(enter).collect();
        assert_eq!(clients(), [1, 39]);
        others.iter().for_each(Place::note_speech);
        let last = enter(40);
        assert_eq!(clients(), [39, 40]);
        drop((first, last));
    }
}
