//! Where the database lies: a local disk with some space left, and nobody else's.

use std::ffi::OsString;
use std::fs::{File, TryLockError};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use super::OpenError;

/// Less free space than this is refused.
const LEAST_FREE_MIB: u64 = 64;

/// Holds a database for one server. Released when dropped, and by the system when the process dies.
#[derive(Debug)]
pub(super) struct Lock(
    #[expect(dead_code, reason = "held for its lock, which closing releases")] File,
);

impl Lock {
    /// Takes `DATABASE.lock`, or says who is in the way. The lock goes by the file's own name, so that a symbolic link
    /// is no way around it; a file with two names of its own is refused, because SQLite's log goes by the name too.
    pub(super) fn take(database: &Path) -> Result<Self, OpenError> {
        let own_name = database
            .canonicalize()
            .unwrap_or_else(|_| database.to_owned());
        if std::fs::metadata(&own_name).is_ok_and(|found| found.nlink() > 1) {
            return Err(OpenError::Linked(own_name));
        }
        let path = with_suffix(&own_name, ".lock");
        let failed = |source| OpenError::Lock {
            path: path.clone(),
            source,
        };
        let file = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(&path)
            .map_err(failed)?;
        match file.try_lock() {
            Ok(()) => Ok(Self(file)),
            Err(TryLockError::WouldBlock) => Err(OpenError::InUse(database.to_owned())),
            Err(TryLockError::Error(source)) => Err(OpenError::Lock { path, source }),
        }
    }
}

/// Makes the file of a new database, for its owner alone to read: it will hold answers, ids and the server's secret. SQLite
/// gives its log the same rights.
pub(super) fn create_private(database: &Path) -> Result<(), OpenError> {
    let made = File::options()
        .create_new(true)
        .write(true)
        .mode(0o600)
        .open(database);
    match made {
        Ok(_) => Ok(()),
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => Ok(()),
        Err(source) => Err(OpenError::Folder {
            path: database.to_owned(),
            source,
        }),
    }
}

/// A file that lies beside the database, such as its write-ahead log.
pub(super) fn with_suffix(database: &Path, suffix: &str) -> PathBuf {
    let mut path = OsString::from(database);
    path.push(suffix);
    path.into()
}

/// Refuses network file systems and nearly full disks. Returns the free space in MiB.
pub(super) fn require_trustworthy(database: &Path) -> Result<u64, OpenError> {
    let folder = match database.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        Some(_) | None => Path::new("."),
    };
    let failed = |err: rustix::io::Errno| OpenError::Folder {
        path: folder.to_owned(),
        source: err.into(),
    };
    #[cfg(target_os = "linux")]
    {
        let found = rustix::fs::statfs(folder).map_err(failed)?;
        // The magic numbers have 32 bits; the field's width differs between architectures.
        match trust(found.f_type as u32) {
            Trust::Local => {}
            Trust::Refused(name) => {
                return Err(OpenError::NetworkFileSystem {
                    path: database.to_owned(),
                    name,
                });
            }
            Trust::Doubtful(name) => tracing::warn!(
                database = %database.display(),
                "the database is on a {name} file system; make sure that its locks and syncs can be trusted"
            ),
        }
    }
    let space = rustix::fs::statvfs(folder).map_err(failed)?;
    let free_mib = space.f_bavail.saturating_mul(space.f_frsize) >> 20;
    if free_mib < LEAST_FREE_MIB {
        return Err(OpenError::DiskFull {
            path: folder.to_owned(),
            free_mib,
            least_mib: LEAST_FREE_MIB,
        });
    }
    Ok(free_mib)
}

#[derive(Debug, PartialEq, Eq)]
enum Trust {
    Local,
    /// Its locks and syncs do not hold what SQLite needs.
    Refused(&'static str),
    /// They may or may not.
    Doubtful(&'static str),
}

/// Sorts file systems by their magic numbers (linux/magic.h, and statfs(2)).
fn trust(magic: u32) -> Trust {
    match magic {
        0x6969 => Trust::Refused("NFS"),
        0x517b => Trust::Refused("SMB"),
        0xfe53_4d42 => Trust::Refused("SMB2"),
        0xff53_4d42 => Trust::Refused("CIFS"),
        0x564c => Trust::Doubtful("NCP"),
        0x0102_1997 => Trust::Doubtful("9P"),
        0x6573_5546 => Trust::Doubtful("FUSE"),
        0x00c3_6400 => Trust::Doubtful("Ceph"),
        0x5346_414f => Trust::Doubtful("AFS"),
        0x7375_7245 => Trust::Doubtful("Coda"),
        0x0bd0_0bd0 => Trust::Doubtful("Lustre"),
        0x7461_636f => Trust::Doubtful("OCFS2"),
        0x0116_1970 => Trust::Doubtful("GFS2"),
        _ => Trust::Local,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn network_file_systems_are_refused_and_other_remote_ones_doubted() {
        assert_eq!(trust(0x6969), Trust::Refused("NFS"));
        assert_eq!(trust(0xff53_4d42), Trust::Refused("CIFS"));
        assert_eq!(trust(0x6573_5546), Trust::Doubtful("FUSE"));
        // ext4, btrfs, xfs, tmpfs, overlayfs
        for local in [0xef53, 0x9123_683e, 0x5846_5342, 0x0102_1994, 0x794c_7630] {
            assert_eq!(trust(local), Trust::Local);
        }
    }

    #[test]
    fn a_missing_folder_is_named() {
        let err = require_trustworthy(Path::new("/no/such/folder/riskaware.db")).unwrap_err();
        assert!(
            err.to_string().starts_with("folder /no/such/folder: "),
            "{err}"
        );
    }
}
