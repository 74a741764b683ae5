//! Places for answers that go on: so many at a time, and half of them at most for one credential.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tonic::Status;

use super::guard::Asker;

/// The places of one kind; cheap to clone.
#[derive(Clone, Debug)]
pub struct Places {
    what: &'static str,
    most: usize,
    taken: Arc<Mutex<Taken>>,
}

/// By the names of credentials; none, where no credential is needed.
type Taken = HashMap<Option<String>, usize>;

/// One of them; given back when it goes.
#[derive(Debug)]
pub struct Place {
    of: Option<String>,
    taken: Arc<Mutex<Taken>>,
}

impl Places {
    /// So many, for what is called that in the plural.
    pub fn new(what: &'static str, most: usize) -> Self {
        Self { what, most, taken: Arc::default() }
    }

    /// A place for this caller.
    pub fn take(&self, asker: &Asker) -> Result<Place, Status> {
        self.take_for(asker.credential().map(str::to_owned))
    }

    fn take_for(&self, of: Option<String>) -> Result<Place, Status> {
        let Self { what, most, .. } = *self;
        let mut taken = lock(&self.taken);
        if taken.values().sum::<usize>() >= most {
            let full = format!("{most} {what} are open already; end one of them");
            return Err(Status::resource_exhausted(full));
        }
        let own = taken.get(&of).copied().unwrap_or_default();
        if let Some(name) = of.as_ref().filter(|_| own >= most / 2) {
            let full = format!("credential {name} has {own} of {most} {what}; end one of them");
            return Err(Status::resource_exhausted(full));
        }
        taken.insert(of.clone(), own + 1);
        Ok(Place { of, taken: Arc::clone(&self.taken) })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = lock(&self.taken);
        if let Some(own) = taken.get_mut(&self.of) {
            *own -= 1;
            if *own == 0 {
                taken.remove(&self.of);
            }
        }
    }
}

/// Counting is whole after each step, whatever became of who held it.
fn lock(taken: &Mutex<Taken>) -> MutexGuard<'_, Taken> {
    taken.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_credential_leaves_room_for_others_and_nobody_is_asked_where_none_is_needed() {
        let places = Places::new("watches", 4);
        let take = |name: &str| places.take_for(Some(name.to_owned()));
        let anna: Vec<_> = [take("anna").unwrap(), take("anna").unwrap()].into();
        let refused = take("anna").unwrap_err();
        assert_eq!(refused.message(), "credential anna has 2 of 4 watches; end one of them");
        let bert = [take("bert").unwrap(), take("bert").unwrap()];
        let refused = take("carl").unwrap_err();
        assert_eq!(refused.message(), "4 watches are open already; end one of them");
        drop(anna);
        assert!(take("carl").is_ok());
        drop(bert);
        assert!(lock(&places.taken).is_empty(), "whoever is gone is forgotten");

        let local: Vec<_> = (0..4).map(|_| places.take_for(None).unwrap()).collect();
        assert!(places.take_for(None).is_err());
        drop(local);
    }
}
